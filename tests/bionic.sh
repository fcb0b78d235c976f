#!/usr/bin/env bash
# The library and the programs of tests/c on Android's own linker and C library, without a phone: x86_64 natively,
# arm64 under qemu-user. By hand: it needs Android's NDK and the system of a device or of an emulator's image.
#
#   SVBRDF_BIONIC=FOLDER ANDROID_NDK_HOME=NDK tests/bionic.sh [TEST...]
#
# FOLDER has x86_64/ or arm64/ or both. Each has the output of `adb pull /system` (bin/linker64 and lib64 suffice) as
# system/, and, from Android 10 on, `adb pull /apex/com.android.runtime` as apex/com.android.runtime/.
# SVBRDF_BUILT=FOLDER: libraries that were built before, in arm64-v8a/ and x86_64/. Else cargo-ndk builds them.
#
# Without ANDROID_NDK_HOME: the newest NDK that Debian's google-android-ndk-*-installer (contrib) has put into place.
#
# Needs root (it changes the root folder of the programs), readelf, libjpeg-turbo-progs, and for arm64 qemu-user-static.
set -euo pipefail
cd "$(dirname "$0")/.."
skip() { echo "SKIPPED: $*"; }
if [ -z "${ANDROID_NDK_HOME:-}" ]; then
  installed=$(find /usr/lib/android-sdk/ndk* -maxdepth 2 -name toolchains -printf '%h\n' 2>/dev/null || true)
  ANDROID_NDK_HOME=$(sort -V <<< "$installed" | tail -n 1)
  export ANDROID_NDK_HOME
fi
if [ -z "${SVBRDF_BIONIC:-}" ] || [ ! -d "${ANDROID_NDK_HOME:-}" ]; then
  skip "Android's C library; SVBRDF_BIONIC is not set, or there is no NDK"
  exit 0
fi
[ "$(id -u)" = 0 ] || { echo "tests/bionic.sh needs root" >&2; exit 1; }
tests=("$@")
[ ${#tests[@]} -gt 0 ] || mapfile -t tests < <(grep -o '{"[a-z-]*", *test_' tests/c/main.c | cut -d '"' -f 2)
# The level of android-example/aar.sh.
api=26
compilers=$(echo "$ANDROID_NDK_HOME"/toolchains/llvm/prebuilt/*/bin)
work=$(mktemp -d)
finish() {
  for mounted in "$work"/root-*/{proc,dev}; do umount "$mounted" 2>/dev/null || true; done
  rm -rf --one-file-system "$work"
}
trap finish EXIT

ran=0
for abi in x86_64 arm64-v8a; do
  case $abi in
    x86_64) arch=x86_64 source=$SVBRDF_BIONIC/x86_64 ;;
    *) arch=aarch64 source=$SVBRDF_BIONIC/arm64 ;;
  esac
  if [ ! -x "$source/system/bin/linker64" ]; then skip "$abi: $source/system/bin/linker64 is not there"; continue; fi
  emulator=
  if [ "$(uname -m)" != $arch ]; then
    emulator=$(command -v qemu-$arch-static) || { skip "$abi: qemu-user-static is missing"; continue; }
  fi
  built=${SVBRDF_BUILT:-}
  if [ -z "$built" ]; then
    built=$work/built
    cargo ndk -t $abi --platform $api -o "$built" build --release -p svbrdf-ffi
  fi
  root=$work/root-$abi
  place=$root/data/local/tmp
  mkdir -p "$root/proc" "$root/dev" "$place"
  cp -rL --no-preserve=ownership "$source/system" "$root/"
  [ ! -d "$source/apex" ] || cp -rL --no-preserve=ownership "$source/apex" "$root/"
  [ -z "$emulator" ] || cp "$emulator" "$root/emulator"
  cp "$built/$abi/libsvbrdf.so" "$place"
  # Debian's djpeg decodes as the library does, up to rounding: clients read PPM.
  cp -r models "$place/models"
  cp -r examples/captures/tile "$place/capture"
  for photo in 00 01 02; do djpeg -ppm examples/captures/tile/frames/$photo.jpg > "$place/$photo.ppm"; done
  "$compilers/$arch-linux-android$api-clang" -std=c99 -O1 -Wall -Wextra -Werror -D_DEFAULT_SOURCE -I include \
    tests/c/*.c -L "$place" -lsvbrdf -lm -o "$place/client"
  "$compilers/$arch-linux-android$api-clang" -std=gnu11 -O1 -Wall -Wextra -Werror -I include \
    ffi/tests/clients/unload.c -ldl -o "$place/unload"
  mount --bind /proc "$root/proc"
  mount --bind /dev "$root/dev"
  inside() {
    timeout "$limit" chroot "$root" ${emulator:+/emulator} "$@"
  }
  export LD_LIBRARY_PATH=/data/local/tmp ANDROID_ROOT=/system TMPDIR=/data/local/tmp
  limit=$([ -z "$emulator" ] && echo 600 || echo 7200)
  for test in "${tests[@]}"; do
    echo "$abi: $test"
    inside /data/local/tmp/client "$test" /data/local/tmp
  done
  echo "$abi: unload"
  inside /data/local/tmp/unload /data/local/tmp/libsvbrdf.so /data/local/tmp/capture
  unset LD_LIBRARY_PATH ANDROID_ROOT TMPDIR
  umount "$root/proc" "$root/dev"
  ran=$((ran + 1))
done
[ $ran -gt 0 ] || exit 0
echo "bionic: all fine; ${#tests[@]} programs and unloading, for $ran processors"
