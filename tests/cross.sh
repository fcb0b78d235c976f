#!/usr/bin/env bash
# The command for other systems, built here by Debian's cross compilers and run here: arm64 Linux under qemu, Windows under
# wine. Each fits a photograph of the bundled capture; its maps are compared with those of this machine's command. By hand:
# it compiles everything once more for each.
#
#   tests/cross.sh [TARGET...]      aarch64-unknown-linux-gnu, x86_64-pc-windows-gnu
#
# PROFILE is `release` unless set. Needs rustup, for the targets' standard libraries.
set -euo pipefail
cd "$(dirname "$0")/.."
. ffi/packaging/cross.sh
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=(aarch64-unknown-linux-gnu x86_64-pc-windows-gnu)
profile=${PROFILE:-release}
folder=${CARGO_TARGET_DIR:-target}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export WINEPREFIX=$work/wine
fit=(fit examples/captures/tile --frames 1 --steps 8 --quiet --no-report)
cargo build --quiet --release --workspace --bin svbrdf
native=$folder/release/svbrdf
"$native" "${fit[@]}" --out "$work/native"
for target in "${targets[@]}"; do
  cross "$target"
  cargo rustc --locked --profile "$profile" --target "$target" -p svbrdf-cli --bin svbrdf -- -C target-feature=+crt-static
  binary=$folder/$target/$profile/svbrdf
  [ -f "$binary" ] || binary=$binary.exe
  "$RUNNER" "$binary" --version
  "$RUNNER" "$binary" "${fit[@]}" --out "$work/$target"
  # Other vector instructions and another C library: as between processors with and without AVX2.
  "$native" compare "$work/$target" "$work/native" --json > "$work/difference"
  python3 - "$target" "$work/difference" <<'END'
import json, sys

found = json.load(open(sys.argv[2]))
found = {name: found[name] for name in ("normal", "diffuse", "specular", "roughness", "render")}
assert max(found.values()) < 1e-3, f"{sys.argv[1]}: maps differ: {found}"
print(f"{sys.argv[1]}: maps differ by {max(found.values()):.1e} at most from this machine's")
END
done
echo "cross builds: all fine"
