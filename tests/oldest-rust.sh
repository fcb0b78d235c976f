#!/usr/bin/env bash
# Compiles everything, tests included, with the oldest Rust that Cargo.toml states (`rust-version`): no code is
# generated. Installs that Rust by rustup where it is missing. Arguments are handed to cargo check.
set -euo pipefail
cd "$(dirname "$0")/.."
version=$(sed -n '/^\[workspace.package\]/,/^$/s/^rust-version = "\(.*\)"$/\1/p' Cargo.toml)
rustup run "$version" rustc --version 2> /dev/null || rustup toolchain install "$version" --profile minimal
# A folder of its own: artefacts of two compilers in one are built anew at each change between them.
CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-target}/oldest-rust cargo "+$version" check --release --locked \
  --workspace --exclude svbrdf-opencv-oracle --all-targets "$@"
echo "Rust $version: compiles"
