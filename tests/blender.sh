#!/usr/bin/env bash
# Shows exports in Blender (the package bpy of PyPI, some 350 MB) and compares them with the
# library's renderings, then installs the extension of ffi/blender and runs its tests. BPY names a version of bpy.
# Not part of tests/run.sh; the figures are in docs/exports.md.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-$PWD/target}
tools=$target/exports-tools
environment=$tools/blender${BPY:+-$BPY}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
[ -x "$target/release/svbrdf" ] || cargo build --release --workspace --bin svbrdf
mkdir -p "$tools"
if ! "$environment/bin/python" -c 'import bpy, pytest' 2>/dev/null; then
  python3 -m venv "$environment"
  # Blender 4 is made for the first major version of numpy.
  case ${BPY:-} in 4*) numpy='numpy<2' ;; *) numpy=numpy ;; esac
  "$environment/bin/pip" install -q "bpy${BPY:+==$BPY}" "$numpy" pytest ||
    { echo "SKIPPED: bpy cannot be had for this Python"; exit 0; }
fi
captures=()
if [ -n "${SVBRDF_TEST_DATA:-}" ]; then
  captures=("$SVBRDF_TEST_DATA"/captures/dev/{leather,tile}/truth)
else
  echo "SKIPPED: exports of captures; SVBRDF_TEST_DATA is not set"
fi
tests/exports/cases.sh "$target/release/svbrdf" "$work/cases" "${captures[@]}"
"$environment/bin/python" tests/exports/blender.py "$work/cases" 0.1 | grep --line-buffered ^Blender

"$environment/bin/pip" install -q 'maturin>=1.9,<2'
(cd ffi/python && "$environment/bin/maturin" build --profile release --locked --quiet --out "$work/wheel")
python3 ffi/blender/build.py "$work/svbrdf.zip" "$work"/wheel/*.whl
# As `blender --command extension validate` does.
package=$("$environment/bin/python" -c 'import importlib.util as util; print(util.find_spec("bpy").submodule_search_locations[0])')
"$environment/bin/python" "$package"/*/scripts/addons_core/bl_pkg/cli/blender_ext.py validate "$work/svbrdf.zip"
mkdir "$work/resources"
EXTENSION=$work/svbrdf.zip BLENDER_USER_RESOURCES=$work/resources SVBRDF_CLI=$target/release/svbrdf \
  "$environment/bin/python" -m pytest -q -s -p no:cacheprovider ffi/blender/tests
