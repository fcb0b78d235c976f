#!/usr/bin/env bash
# Runs every check of the repository; installs the system packages they need when missing
# (Debian, Ubuntu). SVBRDF_TEST_DATA may name a folder with further captures: what is missing there
# fails; without it, the last lines name and count what was left out.
set -euo pipefail
cd "$(dirname "$0")/.."

SVBRDF_SKIPPED=$(mktemp)
export SVBRDF_SKIPPED
count_skipped() {
  if [ -s "$SVBRDF_SKIPPED" ]; then
    sort -u "$SVBRDF_SKIPPED" | sed 's/^/  /'
    echo "SKIPPED: these $(sort -u "$SVBRDF_SKIPPED" | wc -l) checks; SVBRDF_TEST_DATA or a tool is missing"
  fi
  rm -f "$SVBRDF_SKIPPED"
}
trap count_skipped EXIT

packages=()
pkg-config --exists opencv4 2>/dev/null || packages+=(pkg-config libopencv-dev)
ls /usr/lib/llvm-*/lib/libclang.so* >/dev/null 2>&1 || packages+=(clang libclang-dev)
for tool in gcc g++ make; do
  command -v "$tool" >/dev/null || { packages+=(build-essential); break; }
done
command -v valgrind >/dev/null || packages+=(valgrind)
command -v parallel >/dev/null || packages+=(parallel)
command -v cmake >/dev/null || packages+=(cmake)
if [ ${#packages[@]} -gt 0 ]; then
  sudo=$([ "$(id -u)" = 0 ] || echo sudo)
  $sudo apt-get update -q
  DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qy --no-install-recommends "${packages[@]}"
fi

# For android-example; its tests are skipped where these cannot be had.
android=()
command -v javac >/dev/null || android+=(default-jdk-headless)
command -v npm >/dev/null || android+=(npm)
for tool in aapt zipalign apksigner; do
  command -v "$tool" >/dev/null || android+=("$tool")
done
[ -f /usr/share/android-framework-res/framework-res.apk ] || android+=(android-framework-res)
if [ ${#android[@]} -gt 0 ]; then
  sudo=$([ "$(id -u)" = 0 ] || echo sudo)
  $sudo apt-get update -q &&
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qy --no-install-recommends "${android[@]}" ||
    echo "packages for android-example" >> "$SVBRDF_SKIPPED"
fi
# Downloads, while the compiler works.
{
  tests/swift-tools.sh || echo "a Swift compiler, for ffi/swift" >> "$SVBRDF_SKIPPED"
  tests/android-tools.sh || echo "tools for android-example" >> "$SVBRDF_SKIPPED"
} &
tools=$!

cargo fmt --all --check
cargo clippy --release --workspace --all-targets -- -D warnings
wait "$tools"
cargo test --release --workspace "$@"
tests/package.sh
tests/licences.sh
tests/exports.sh
tests/inlined.sh
tests/report.sh
tests/python.sh
RUSTDOCFLAGS="-D warnings" cargo doc --release --no-deps --workspace --quiet
