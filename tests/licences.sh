#!/usr/bin/env bash
# Licences and sources of all dependencies on all platforms, by cargo-deny; `tests/dependencies.rs`
# checks licences on this platform without it.
set -euo pipefail
cd "$(dirname "$0")/.."
if ! command -v cargo-deny >/dev/null; then
  echo "SKIPPED: licences on other platforms: cargo-deny is not installed"
  echo "licences on other platforms (cargo-deny)" >> "${SVBRDF_SKIPPED:-/dev/null}"
  exit 0
fi
cargo deny --workspace --config ffi/packaging/deny.toml check licenses bans sources
