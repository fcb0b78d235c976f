#!/usr/bin/env bash
# Spelling of sources and documents, by typos: the one on the path, or else a package of PyPI below target/.
# With --installed it gets none.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=${CARGO_TARGET_DIR:-$PWD/target}/spelling-tools
typos=$(command -v typos || echo "$tools/bin/typos")
if [ ! -x "$typos" ] && { [ "${1:-}" = --installed ] || ! python3 -m venv "$tools" || ! "$tools/bin/pip" install -q 'typos==1.*'; }; then
  echo "SKIPPED: spelling; typos cannot be had"
  echo "spelling (typos)" >> "${SVBRDF_SKIPPED:-/dev/null}"
  exit 0
fi
"$typos" --config tests/typos.toml
