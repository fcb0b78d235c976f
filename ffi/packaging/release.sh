#!/usr/bin/env bash
# Builds what a release consists of, as far as this machine can:
#
#   ffi/packaging/release.sh OUT PART...
#
#   cli          the command as an archive with licences, for this system; statically linked on Linux
#   wheel        the Python wheel for this system (Python 3.10 and later)
#   deb          Debian's packages
#   aar          the Android archive (NDK, cargo-ndk)
#   xcframework  the framework for Swift (a Mac)
#   web          the web page
#   source       the source archive, and conda's recipe with its checksum
#   extension    Blender's extension, of the wheels in OUT
#   finish       SHA256SUMS, and provenance.json, which says how everything in OUT was made
#
# TARGET names another target that rustup has, for `cli` and `wheel` (TARGET=x86_64-apple-darwin). On Debian, arm64 Linux and Windows
# (aarch64-unknown-linux-gnu, x86_64-pc-windows-gnu) are built by cross compilers, and run by qemu and wine. PROFILE is `dist` unless set.
# Bills of materials and texts of licences come from notices.sh; its tools are needed, but for `source`, `extension` and `finish`.
set -euo pipefail
if [ $# -lt 2 ]; then
  sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "$0" >&2
  exit 2
fi
mkdir -p "$1"
out=$(cd "$1" && pwd)
shift
cd "$(dirname "$0")/../.."
root=$PWD
profile=${PROFILE:-dist}
host=$(rustc -vV | sed -n 's/^host: //p')
target=${TARGET:-$host}
version=$(sed -n '/^\[workspace.package\]/,/^$/s/^version = "\(.*\)"$/\1/p' Cargo.toml)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
RUNNER=
case $host:$target in
  x86_64-unknown-linux-gnu:aarch64-unknown-linux-gnu | x86_64-unknown-linux-gnu:x86_64-pc-windows-gnu)
    . ffi/packaging/cross.sh
    export WINEPREFIX=$work/wine
    cross "$target" ;;
esac
sum() { if command -v sha256sum > /dev/null; then sha256sum "$@"; else shasum -a 256 "$@"; fi; }

# Licences and bill of materials, once for all parts.
notices() {
  [ -d "$work/notices" ] || ffi/packaging/notices.sh "$work/notices" "$target" > /dev/null
}

cli() {
  local built=${CARGO_TARGET_DIR:-$root/target} name=svbrdf-$version-$target suffix=
  local flags=()
  case $target in
    *-linux-*) flags=(-C target-feature=+crt-static) ;;
    *-windows-*) flags=(-C target-feature=+crt-static) suffix=.exe ;;
  esac
  notices
  cargo rustc --locked --profile "$profile" --target "$target" -p svbrdf-cli --bin svbrdf -- ${flags[@]+"${flags[@]}"}
  local binary=$built/$target/$profile/svbrdf$suffix folder=$work/$name
  mkdir -p "$folder"
  cp "$binary" README.md LICENSE-MIT LICENSE-APACHE "$work/notices/THIRD-PARTY.txt" "$folder"
  case $target in
    *-linux-*) if readelf -dW "$binary" | grep NEEDED; then echo "$binary is not linked statically" >&2; exit 1; fi ;;
  esac
  # Without an emulator, another processor's binary does not run here.
  if [ -n "$RUNNER" ] || [ "${target%%-*}" = "${host%%-*}" ]; then
    $RUNNER "$binary" fit examples/captures/tile --frames 1 --steps 2 --quiet --out "$work/maps"
  fi
  case $target in
    *-windows-*) (cd "$work" && "$(command -v python3 || command -v python)" -m zipfile -c "$out/$name.zip" "$name") ;;
    *) tar -C "$work" --owner=0 --group=0 --numeric-owner -czf "$out/$name.tar.gz" "$name" 2>/dev/null ||
      tar -C "$work" -czf "$out/$name.tar.gz" "$name" ;;
  esac
  cp "$work/notices/svbrdf-cli.cdx.json" "$out/$name.cdx.json"
}

wheel() {
  notices
  cp "$work/notices/THIRD-PARTY.txt" ffi/python
  trap 'rm -rf "$work" "$root/ffi/python/THIRD-PARTY.txt"' EXIT
  local options=(--profile "$profile" --locked --out "$out")
  [ -z "${TARGET:-}" ] || options+=(--target "$target")
  # Linux: runs on every distribution whose C library is not older, as the name says. MANYLINUX=2_28 or musllinux_1_2 needs zig.
  [ -z "${MANYLINUX:-}" ] || options+=(--compatibility "$MANYLINUX" --zig)
  (cd ffi/python && maturin build "${options[@]}")
  cp "$work/notices/svbrdf.cdx.json" "$out/svbrdf-$version-$target.cdx.json"
}

deb() {
  notices
  SVBRDF_NOTICES=$work/notices ffi/packaging/deb.sh "$out" "$profile"
}

aar() {
  target=aarch64-linux-android notices
  android-example/aar.sh "$work/aar" --notices "$work/notices/THIRD-PARTY.txt"
  tar -C "$work/aar" -czf "$out/svbrdf-$version-android-maven.tar.gz" org
}

xcframework() {
  ffi/swift/xcframework.sh "$work/swift"
  (cd "$work/swift" && zip -qry "$out/SVBRDF.xcframework.zip" SVBRDF.xcframework)
}

web() {
  PROFILE=$profile ffi/web/build.sh
  tar -C ffi/web/dist -czf "$out/svbrdf-$version-web.tar.gz" .
}

source_archive() {
  local archive=$out/svbrdf-$version.tar.gz checksum
  git archive --format=tar --prefix="svbrdf-$version/" HEAD | gzip -9n > "$archive"
  checksum=$(sum "$archive" | cut -d ' ' -f 1)
  sed "s/\"0\{64\}\"/\"$checksum\"/" ffi/packaging/conda/recipe.yaml > "$out/svbrdf-$version-conda.yaml"
  grep -q "sha256: \"$checksum\"" "$out/svbrdf-$version-conda.yaml"
}

extension() {
  local wheels=("$out"/svbrdf-"$version"-*.whl)
  [ -f "${wheels[0]}" ] || { echo "no wheel in $out" >&2; exit 1; }
  python3 ffi/blender/build.py "$out/svbrdf-$version-blender.zip" "${wheels[@]}"
}

finish() {
  (cd "$out" && find . -maxdepth 1 -type f ! -name SHA256SUMS ! -name provenance.json | sed 's|^\./||' | sort |
    while read -r file; do sum "$file"; done) > "$work/sums"
  mv "$work/sums" "$out/SHA256SUMS"
  OUT=$out VERSION=$version HOST=$host python3 - "$@" <<'END'
import json, os, pathlib, subprocess, sys

def run(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

out = pathlib.Path(os.environ["OUT"])
sums = [line.split(maxsplit=1) for line in (out / "SHA256SUMS").read_text().splitlines()]
statement = {
    "_type": "https://in-toto.io/Statement/v1",
    "subject": [{"name": name.lstrip("*"), "digest": {"sha256": digest}} for digest, name in sums],
    "predicateType": "https://slsa.dev/provenance/v1",
    "predicate": {
        "buildDefinition": {
            "buildType": "https://github.com/svbrdf/svbrdf/blob/main/ffi/packaging/release.sh",
            "externalParameters": {"version": os.environ["VERSION"]},
            "resolvedDependencies": [
                {"uri": "git+https://github.com/svbrdf/svbrdf", "digest": {"gitCommit": run("git", "rev-parse", "HEAD")}},
                {"uri": "Cargo.lock", "digest": {"gitBlob": run("git", "rev-parse", "HEAD:Cargo.lock")}},
            ],
        },
        "runDetails": {
            "builder": {"id": os.environ.get("GITHUB_SERVER_URL", "local") + "/" + os.environ.get("GITHUB_WORKFLOW_REF", os.environ["HOST"])},
            "metadata": {"changed": bool(run("git", "status", "--porcelain")), "rustc": run("rustc", "--version")},
        },
    },
}
(out / "provenance.json").write_text(json.dumps(statement, indent=1) + "\n")
END
  (cd "$out" && if command -v sha256sum > /dev/null; then sha256sum --check --quiet SHA256SUMS; else shasum -a 256 -c SHA256SUMS; fi)
}

for part; do
  case $part in
    cli | wheel | deb | aar | xcframework | web | extension | finish) "$part" ;;
    source) source_archive ;;
    *) echo "no part $part" >&2; exit 2 ;;
  esac
done
ls -l "$out"
