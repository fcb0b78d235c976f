#!/usr/bin/env bash
# Shows exports in Blender (the package bpy of PyPI, some 350 MB) and compares them with the
# library's renderings. Not part of tests/run.sh; the figures are in docs/exports.md.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=$PWD/target/exports-tools
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
[ -x target/release/svbrdf ] || cargo build --release -p svbrdf-cli --bin svbrdf
mkdir -p "$tools"
if ! "$tools/blender/bin/python" -c 'import bpy' 2>/dev/null; then
  python3 -m venv "$tools/blender"
  "$tools/blender/bin/pip" install -q bpy || { echo "SKIPPED: bpy cannot be had for this Python"; exit 0; }
fi
captures=()
if [ -n "${SVBRDF_TEST_DATA:-}" ]; then
  captures=("$SVBRDF_TEST_DATA"/captures/dev/{leather,tile}/truth)
else
  echo "SKIPPED: exports of captures; SVBRDF_TEST_DATA is not set"
fi
tests/exports/cases.sh "$PWD/target/release/svbrdf" "$work/cases" "${captures[@]}"
"$tools/blender/bin/python" tests/exports/blender.py "$work/cases" 0.1 | grep --line-buffered ^Blender
