#!/usr/bin/env bash
# Makes SVBRDF.xcframework (static, for devices, the simulator and macOS) in the folder given.
# Needs macOS with Xcode and rustup; it has not been run by the automatic checks, which have
# neither.
#
#   ffi/swift/xcframework.sh OUT [--no-default-features]
set -euo pipefail
out=${1:?"usage: xcframework.sh OUT [cargo's options]"}
shift
root=$(cd "$(dirname "$0")/../.." && pwd)
cd "$root"
target_dir=${CARGO_TARGET_DIR:-$root/target}
# As Package.swift names them.
export IPHONEOS_DEPLOYMENT_TARGET=${IPHONEOS_DEPLOYMENT_TARGET:-17.0}
export MACOSX_DEPLOYMENT_TARGET=${MACOSX_DEPLOYMENT_TARGET:-14.0}

targets=(aarch64-apple-ios aarch64-apple-ios-sim x86_64-apple-ios aarch64-apple-darwin
  x86_64-apple-darwin)
rustup target add "${targets[@]}"
for target in "${targets[@]}"; do
  cargo build -p svbrdf-ffi --features jxl --profile dist --target "$target" "$@"
done
library() { echo "$target_dir/$1/dist/libsvbrdf.a"; }

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Xcode copies the headers of all frameworks into one folder: in one of their own two module maps do not meet.
mkdir -p "$work/headers/SVBRDF" "$work/simulator" "$work/macos"
cp include/svbrdf.h ffi/swift/module.modulemap "$work/headers/SVBRDF"
lipo -create "$(library aarch64-apple-ios-sim)" "$(library x86_64-apple-ios)" \
  -output "$work/simulator/libsvbrdf.a"
lipo -create "$(library aarch64-apple-darwin)" "$(library x86_64-apple-darwin)" \
  -output "$work/macos/libsvbrdf.a"
mkdir -p "$out"
rm -rf "$out/SVBRDF.xcframework"
xcodebuild -create-xcframework \
  -library "$(library aarch64-apple-ios)" -headers "$work/headers" \
  -library "$work/simulator/libsvbrdf.a" -headers "$work/headers" \
  -library "$work/macos/libsvbrdf.a" -headers "$work/headers" \
  -output "$out/SVBRDF.xcframework"
