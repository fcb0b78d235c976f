#!/usr/bin/env bash
# The library on phones' processors, without a phone: `check` type-checks it for
# aarch64-linux-android, `test` runs its unit tests for aarch64-unknown-linux-gnu (NEON) under
# qemu-user; without an argument both. Arguments after `test` go to cargo instead of `--lib`.
# Installs Debian's cross compilers when missing (Debian 12: a Rust compiler with the targets'
# standard library, which the usual toolchain cannot download everywhere).
set -euo pipefail
cd "$(dirname "$0")/.."

rustc=/usr/bin/rustc
has() { [ "$(dpkg-query -W -f '${Status}' "$1" 2>/dev/null)" = "install ok installed" ]; }
packages=()
for package in rustc-web rust-web-src gcc-aarch64-linux-gnu qemu-user-static clang-19 llvm-19 \
               libstd-rust-web-dev:arm64 libc6:arm64 libc6-dev-arm64-cross; do
  has "$package" || packages+=("$package")
done
if [ ${#packages[@]} -gt 0 ]; then
  sudo=$([ "$(id -u)" = 0 ] || echo sudo)
  $sudo dpkg --add-architecture arm64
  $sudo apt-get update -q
  DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qy --no-install-recommends "${packages[@]}"
fi

export RUSTC=$rustc
# Apart from the usual compiler's.
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-target}/aarch64

check() {
  RUSTC_BOOTSTRAP=1 \
  CC_aarch64_linux_android=clang-19 AR_aarch64_linux_android=llvm-ar-19 \
  CFLAGS_aarch64_linux_android=--target=aarch64-linux-android24 \
    cargo check --release --target aarch64-linux-android -Zbuild-std=std,panic_unwind \
      -p svbrdf -p svbrdf-ffi
}

tests() {
  # Without -L: with it, qemu hangs in programs with threads.
  CC_aarch64_unknown_linux_gnu=aarch64-linux-gnu-gcc \
  CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc \
  CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER=qemu-aarch64-static \
    cargo test --release --target aarch64-unknown-linux-gnu -p svbrdf "$@"
}

case "${1:-all}" in
  check) check ;;
  test) shift; if [ $# -gt 0 ]; then tests "$@"; else tests --lib; fi ;;
  all) check; tests --lib ;;
  *) echo "usage: $0 [check | test [CARGO TEST ARGUMENTS]]" >&2; exit 2 ;;
esac
