#!/usr/bin/env bash
# Builds the page into ffi/web/dist, for any static web server. Takes the standard library of
# `rustup target add wasm32-unknown-unknown` where it is installed, else Debian's rustc-web, which
# has its sources. Installs wasm-bindgen's tool below the target folder when it is missing.
set -euo pipefail
cd "$(dirname "$0")/../.."

target=wasm32-unknown-unknown
folder=${CARGO_TARGET_DIR:-target}
out=ffi/web/dist
# Two libraries, of which a browser loads one (page/library.js): Safari 16.4, Chromium 91 and Firefox 89 have the
# vectors of `simd128`; `relaxed` also has fused multiply-add. Each has a folder of its own: all crates are compiled
# with these features.
libraries=(simd128 relaxed)
features() { case $1 in simd128) echo +simd128 ;; relaxed) echo +simd128,+relaxed-simd ;; esac; }

environment=()
build_std=()
if [ ! -d "$(rustc --print sysroot)/lib/rustlib/$target" ]; then
  packages=()
  [ -d /usr/lib/rustlib/src ] && [ -x /usr/bin/rustc ] || packages+=(rustc-web rust-web-src)
  command -v rust-lld >/dev/null || command -v wasm-ld >/dev/null ||
    ls "$(rustc --print sysroot)"/lib/rustlib/*/bin/rust-lld >/dev/null 2>&1 || packages+=(lld)
  if [ ${#packages[@]} -gt 0 ]; then
    sudo=$([ "$(id -u)" = 0 ] || echo sudo)
    $sudo apt-get update -q
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qy --no-install-recommends "${packages[@]}"
  fi
  linker=$(command -v wasm-ld || command -v rust-lld ||
    ls "$(rustc --print sysroot)"/lib/rustlib/*/bin/rust-lld | head -1)
  environment=(RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1 "CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER=$linker")
  build_std=(-Zbuild-std=std,panic_abort)
fi
for library in "${libraries[@]}"; do
  # Nothing draws random numbers. As much stack as a thread has elsewhere, instead of 1 MiB.
  env "${environment[@]}" RUSTFLAGS="--cfg getrandom_backend=\"unsupported\" -C target-feature=$(features "$library")" \
    cargo rustc --profile "${PROFILE:-release}" -p svbrdf-web --target "$target" --target-dir "$folder/web/$library" \
    "${build_std[@]}" -- -C link-arg=-zstack-size=2097152
done

version=$(sed -n 's/^wasm-bindgen = "=\(.*\)"/\1/p' ffi/web/Cargo.toml)
tools=$folder/web-tools
if [ "$("$tools/bin/wasm-bindgen" --version 2>/dev/null)" != "wasm-bindgen $version" ]; then
  cargo install --quiet --no-default-features wasm-bindgen-cli --version "$version" --root "$tools"
fi

rm -rf "$out"
mkdir -p "$out/example/frames"
unpacked=0
for library in "${libraries[@]}"; do
  "$tools/bin/wasm-bindgen" --target web --no-typescript --remove-name-section \
    --remove-producers-section --out-dir "$out" --out-name "$library" \
    "$folder/web/$library/$target/${PROFILE:-release}/svbrdf_web.wasm"
  wasm=$out/${library}_bg.wasm
  if command -v wasm-opt >/dev/null && [ "${WASM_OPT:-0}" = 1 ]; then
    wasm-opt -O3 --enable-simd --enable-relaxed-simd --enable-bulk-memory --enable-nontrapping-float-to-int \
      --enable-sign-ext --enable-mutable-globals "$wasm" -o "$wasm"
  fi
  # Few servers compress these files: the worker unpacks them.
  gzip -9nc "$wasm" > "$out/$library.bin"
  unpacked=$(wc -c < "$wasm")
  rm "$wasm"
done
for network in decoder.bin encoder.onnx photo.onnx completion.onnx; do
  gzip -9nc "models/$network" > "$out/${network%.*}.bin"
done
cp examples/captures/tile/capture.json "$out/example"
cp examples/captures/tile/frames/*.jpg "$out/example/frames"
cp docs/overview.jpg "$out"
cp cli/src/report/{viewer.js,charts.js,stage.js,style.css} ffi/web/page/* "$out"

# The stage is the report's.
stage=$(sed -n '/<div class="stage">/,/<div id="timeline"/p' cli/src/report/page.html | sed '$d')
awk -v stage="$stage" '$0 == "{{stage}}" { print stage; next } { print }' ffi/web/page/index.html > "$out/index.html"

# Bytes of each file, for the bar.
sizes() {
  local name
  for name; do echo "\"$name.bin\": $(wc -c < "$out/$name.bin")"; done | paste -sd,
}
echo "{ \"libraries\": { $(sizes "${libraries[@]}") }, \"networks\": { $(sizes decoder encoder photo completion) } }" > "$out/sizes.json"
# Every change of a file makes another version.
files=$(cd "$out" && find . -type f ! -name service-worker.js | sort)
hash=$(cd "$out" && xargs sha256sum <<< "$files" | sha256sum | cut -c1-16)
list=$(sed 's/.*/"&"/' <<< "$files" | paste -sd, | sed 's/^/["."\,/; s/$/]/')
sed "s/{{version}}/$hash/; s|{{files}}|$list|" ffi/web/page/service-worker.js > "$out/service-worker.js"

# What a browser loads.
size=$(cat $(find "$out" -type f ! -name 'simd128.*') | wc -c)
echo "$out: $((size / 1000)) kB in a browser, of which the library $(($(wc -c < "$out/relaxed.bin") / 1000)) kB, unpacked $((unpacked / 1000)) kB"
[ "$size" -le 16000000 ] || { echo "a browser loads more than 16 MB of $out" >&2; exit 1; }
