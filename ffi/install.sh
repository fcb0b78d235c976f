#!/usr/bin/env bash
# Installs the library for C and C++ on Linux and macOS:
#
#   ffi/install.sh PREFIX [cargo's options]
#
# PREFIX gets include/, lib/, lib/pkgconfig and lib/cmake/svbrdf. The profile is `dist` unless the options
# name another: `--release` builds faster what is larger. `--no-default-features` leaves the networks out.
# DESTDIR is honoured. SVBRDF_BUILT names a folder with a library that was built before.
#
# Use this instead of cargo's output: the loader looks for the library by the name inside it, libsvbrdf.so.0,
# which cargo does not make.
set -euo pipefail
if [ $# -lt 1 ]; then
  sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "$0" >&2
  exit 2
fi
prefix=$1
shift
root=$(cd "$(dirname "$0")/.." && pwd)
version=$(sed -n '/^\[workspace.package\]/,/^$/s/^version = "\(.*\)"$/\1/p' "$root/Cargo.toml")
major=${version%%.*}

built=${SVBRDF_BUILT:-}
if [ -z "$built" ]; then
  profile=dist
  arguments=("$@")
  for ((i = 0; i < ${#arguments[@]}; i++)); do
    case ${arguments[i]} in
      --release) profile=release ;;
      --profile) profile=${arguments[i + 1]} ;;
      --profile=*) profile=${arguments[i]#*=} ;;
    esac
  done
  if [ "$profile" = dist ]; then
    arguments+=(--profile dist)
  fi
  (cd "$root" && cargo build -p svbrdf-ffi "${arguments[@]}")
  built=${CARGO_TARGET_DIR:-$root/target}/$profile
fi

place=${DESTDIR:-}$prefix
install -d "$place/include/svbrdf" "$place/lib/pkgconfig" "$place/lib/cmake/svbrdf"
install -m 644 "$root/include/svbrdf.h" "$root/include/svbrdf.hpp" "$place/include"
install -m 644 "$root"/include/svbrdf/*.hpp "$place/include/svbrdf"
if [ -f "$built/libsvbrdf.dylib" ]; then
  install -m 755 "$built/libsvbrdf.dylib" "$place/lib/libsvbrdf.$major.dylib"
  install_name_tool -id "$prefix/lib/libsvbrdf.$major.dylib" "$place/lib/libsvbrdf.$major.dylib"
  ln -sf "libsvbrdf.$major.dylib" "$place/lib/libsvbrdf.dylib"
else
  install -m 755 "$built/libsvbrdf.so" "$place/lib/libsvbrdf.so.$version"
  ln -sf "libsvbrdf.so.$version" "$place/lib/libsvbrdf.so.$major"
  ln -sf "libsvbrdf.so.$major" "$place/lib/libsvbrdf.so"
fi
if [ -f "$built/libsvbrdf.a" ]; then
  install -m 644 "$built/libsvbrdf.a" "$place/lib"
fi
fill() { sed -e "s|@VERSION@|$version|" -e "s|@PREFIX@|$prefix|" "$1"; }
fill "$root/ffi/svbrdf.pc.in" > "$place/lib/pkgconfig/svbrdf.pc"
install -m 644 "$root/ffi/cmake/svbrdf-config.cmake" "$place/lib/cmake/svbrdf"
fill "$root/ffi/cmake/svbrdf-config-version.cmake.in" \
  > "$place/lib/cmake/svbrdf/svbrdf-config-version.cmake"
echo "svbrdf $version is in $place"
case $prefix in
  /usr | /usr/local) ;;
  *)
    echo "  CMake:      -DCMAKE_PREFIX_PATH=$prefix"
    echo "  pkg-config: PKG_CONFIG_PATH=$prefix/lib/pkgconfig"
    echo "  at run time, unless linked with an rpath: LD_LIBRARY_PATH=$prefix/lib"
    ;;
esac
[ "$prefix" != /usr/local ] || [ -n "${DESTDIR:-}" ] || ! command -v ldconfig >/dev/null || ldconfig 2>/dev/null || true
