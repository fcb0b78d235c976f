#!/usr/bin/env bash
# examples/python/many.py (Dask) with the wheel: three workers of which one is killed, a second run, other settings, an object
# store (the server moto on this computer), too little memory, Ctrl-C. By hand: downloads 150 MB from PyPI; some minutes.
# WHEEL names a wheel that was built before.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-$PWD/target}
environment=$target/many-tools
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
[ -x "$target/release/svbrdf" ] || cargo build --release --workspace --bin svbrdf
[ -x "$environment/bin/python" ] || python3 -m venv "$environment"
wheel=${WHEEL:-}
if [ -z "$wheel" ]; then
  "$environment/bin/pip" install -q 'maturin>=1.9,<2'
  (cd ffi/python && "$environment/bin/maturin" build --profile release --locked --quiet --out "$work/wheel")
  wheel=$(ls "$work"/wheel/*.whl)
fi
"$environment/bin/pip" install -q --upgrade "$wheel" dask distributed pyarrow s3fs 'moto[server]' ||
  { echo "SKIPPED: many captures with Dask; its packages cannot be had"; exit 0; }
mkdir "$work/captures"
"$environment/bin/python" tests/many.py "$target/release/svbrdf" "$work/captures"
