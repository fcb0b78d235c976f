#!/usr/bin/env bash
# Licences, sources and advisories of all dependencies on all platforms, by cargo-deny; `tests/dependencies.rs`
# checks licences on this platform without it.
set -euo pipefail
cd "$(dirname "$0")/.."
if ! command -v cargo-deny >/dev/null; then
  echo "SKIPPED: advisories, and licences on other platforms: cargo-deny is not installed"
  echo "advisories, and licences on other platforms (cargo-deny)" >> "${SVBRDF_SKIPPED:-/dev/null}"
  exit 0
fi
deny() { cargo deny --workspace --config ffi/packaging/deny.toml "$@"; }
deny check licenses bans sources
if deny fetch db; then
  deny check advisories
else
  echo "SKIPPED: advisories: their database cannot be had"
  echo "advisories (the database of RustSec)" >> "${SVBRDF_SKIPPED:-/dev/null}"
fi
