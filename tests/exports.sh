#!/usr/bin/env bash
# Validates exports with the formats' own tools: gltf-validator and three.js (npm), usd-core and
# MaterialX (PyPI), Debian's Chromium. Missing tools are reported and their checks skipped.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-$PWD/target}
tools=$target/exports-tools
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

svbrdf=$target/release/svbrdf
[ -x "$svbrdf" ] || cargo build --release --workspace --bin svbrdf
. tests/tools.sh
has "exports: Node.js" npm nodejs npm || true
has "exports: a browser" chromium chromium || true
need "exports: Python" "python3 -c 'import venv, ensurepip'" python3-venv || true
mkdir -p "$tools"
cp tests/exports/*.mjs tests/exports/views.json "$tools"
modules "exports: packages of npm" "$tools" gltf-validator three "$PLAYWRIGHT" || true
if [ ! -x "$tools/venv/bin/python" ] || ! "$tools/venv/bin/python" -c 'import MaterialX, pxr' 2>/dev/null; then
  { python3 -m venv "$tools/venv" && "$tools/venv/bin/pip" install -q usd-core MaterialX; } ||
    skip "Python packages cannot be had"
fi

# Uniform materials and captures' maps, each rendered by the library for every view.
captures=()
if [ -n "${SVBRDF_TEST_DATA:-}" ]; then
  captures=("$SVBRDF_TEST_DATA"/captures/dev/{leather,tile}/truth)
else
  skip "exports of captures; SVBRDF_TEST_DATA is not set"
fi
command -v node >/dev/null || { skip "exports: no Node.js"; exit 0; }
tests/exports/cases.sh "$svbrdf" "$work/cases" "${captures[@]}"
variant=0
for options in "--metallic --texture png16" "--tile --texture jpeg --max-size 32"; do
  variant=$((variant + 1))
  for maps in "$work"/cases.maps/{varnish,gold,carbon,satin}; do
    # shellcheck disable=SC2086
    "$svbrdf" export "$maps" --format glb,usdz,materialx --sample-mm 76.2 $options \
      --out "$work/variants/$(basename "$maps")-$variant"
  done
done

if [ -d "$tools/node_modules/gltf-validator" ]; then
  node "$tools/glb.mjs" "$work"/{cases,variants}/*/material.glb
else
  skip "gltf-validator"
fi
if "$tools/venv/bin/python" -c 'import MaterialX, pxr' 2>/dev/null; then
  "$tools/venv/bin/python" tests/exports/validate.py \
    "$work"/{cases,variants}/*/{material.usdz,materialx/material.mtlx}
else
  skip "validation of USDZ and MaterialX"
fi
# three.js compensates for multiple scattering, which the library does not: a few percent for rough
# metals; the rest is the rounding of stored values.
if command -v chromium >/dev/null && [ -d "$tools/node_modules/playwright-core" ]; then
  CHROMIUM=$(command -v chromium) node "$tools/three.mjs" "$work/cases" 0.05
else
  skip "three.js: no Chromium"
fi
