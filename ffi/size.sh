#!/usr/bin/env bash
# Prints the size of the shared library with and without models, stripped. Built like releases
# unless a profile is named: ffi/size.sh [PROFILE]; `dist` is smaller and takes minutes to build.
set -euo pipefail
cd "$(dirname "$0")/.."
profile=${1:-release}
folder=${CARGO_TARGET_DIR:-target}/$profile
size() {
  strip -o "$folder/stripped.so" "$folder/libsvbrdf.so"
  stat -c %s "$folder/stripped.so" | awk -v name="$1" '{ printf "libsvbrdf.so %s models: %.1f MB\n", name, $1 / 1e6 }'
  rm "$folder/stripped.so"
}
cargo build --quiet --profile "$profile" -p svbrdf-ffi --lib --no-default-features
size without
# Last, so that what lies there is what tests expect.
cargo build --quiet --profile "$profile" -p svbrdf-ffi --lib
size with
