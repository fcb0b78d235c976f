#!/usr/bin/env bash
# The thread contract of the C library under ThreadSanitizer: library and standard library
# instrumented, the C client of tests/c pushing from four threads, with and without waiting, while
# others poll, take maps, save, pause, change budgets and listen to the library, during a fit that
# ends, is cancelled, is destroyed. Not part of run.sh: everything is compiled once more (about 15
# minutes). Installs Debian's compilers when missing (Debian 12: rustc-web comes with the standard
# library's source).
set -euo pipefail
cd "$(dirname "$0")/.."

has() { [ "$(dpkg-query -W -f '${Status}' "$1" 2>/dev/null)" = "install ok installed" ]; }
packages=()
for package in rustc-web rust-web-src clang-19 libclang-rt-19-dev; do
  has "$package" || packages+=("$package")
done
if [ ${#packages[@]} -gt 0 ]; then
  sudo=$([ "$(id -u)" = 0 ] || echo sudo)
  $sudo apt-get update -q
  DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qy --no-install-recommends "${packages[@]}"
fi

target=x86_64-unknown-linux-gnu
built=${CARGO_TARGET_DIR:-target}/tsan
# The executable brings the sanitizer's runtime along. Dependencies are instrumented, not optimised:
# that compiles in half the time.
RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1 CARGO_TARGET_DIR=$built \
RUSTFLAGS="-Zsanitizer=thread -Zexternal-clangrt" CARGO_PROFILE_RELEASE_DEBUG=line-tables-only \
  cargo build --release -p svbrdf-ffi --lib --target $target -Zbuild-std=std,panic_unwind \
  --config 'profile.release.package."*".opt-level=0'

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$built/$target/release/libsvbrdf.so" "$work/libsvbrdf.so.0"
ln -s libsvbrdf.so.0 "$work/libsvbrdf.so"
ln -s "$PWD/models" "$work/models"
ln -s "$PWD/examples/captures/tile" "$work/capture"
clang-19 -std=c99 -D_DEFAULT_SOURCE -O1 -g -fsanitize=thread -Iinclude tests/c/*.c \
  -L"$work" -lsvbrdf -lm -lpthread -Wl,-rpath,"$work" -o "$work/client"
for object in client libsvbrdf.so; do
  nm -D "$work/$object" | grep __tsan_func_entry > /dev/null || { echo "$object: not instrumented"; exit 1; }
done

export TSAN_OPTIONS="halt_on_error=0 exitcode=66 second_deadlock_stack=1 history_size=4"
for test in ${*:-races threads capture}; do
  echo "== $test"
  "$work/client" "$test" "$work"
done
echo "ThreadSanitizer: no report"
