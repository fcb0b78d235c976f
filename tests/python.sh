#!/usr/bin/env bash
# Builds the Python wheel, installs it into a fresh environment without a compiler, and runs its tests and
# type checks there. PROFILE=dist builds the shipped wheel, with the licences of third parties inside (cargo-about);
# WHEEL names a folder that gets a copy. Needs maturin, numpy, pytest, mypy and, for the example with pictures,
# matplotlib from PyPI.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
profile=${PROFILE:-release}
target=${CARGO_TARGET_DIR:-$root/target}
tools=$target/python-tools
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
skip() {
  echo "SKIPPED: the Python module; $1"
  if [ -n "${SVBRDF_SKIPPED:-}" ]; then echo "the Python module: $1" >> "$SVBRDF_SKIPPED"; fi
  exit 0
}
command -v python3 > /dev/null || skip "there is no python3"
python3 -c 'import sys; sys.exit(sys.version_info < (3, 10))' || skip "Python 3.10 is needed"
if [ ! -x "$tools/bin/maturin" ]; then
  python3 -m venv "$tools" && "$tools/bin/pip" install -q 'maturin>=1.9,<2' || skip "maturin cannot be had"
fi
if [ "$profile" = dist ]; then
  ffi/packaging/notices.sh "$work/notices"
  cp "$work/notices/THIRD-PARTY.txt" ffi/python
  trap 'rm -rf "$work" ffi/python/THIRD-PARTY.txt' EXIT
fi
(cd ffi/python && "$tools/bin/maturin" build --profile "$profile" --locked --quiet --out "$work/wheel")
wheel=$(ls "$work"/wheel/*.whl)
if [ "$profile" = dist ]; then
  python3 -m zipfile -l "$wheel" | grep THIRD-PARTY.txt > /dev/null || { echo "$wheel: no notices inside" >&2; exit 1; }
fi
if [ -n "${WHEEL:-}" ]; then
  mkdir -p "$WHEEL"
  cp "$wheel" "$WHEEL"
fi
echo "$(basename "$wheel"): $(($(stat -c %s "$wheel") / 1024)) KiB"

python3 -m venv "$work/fresh"
# No compiler: the wheel is all there is.
CC=false CXX=false RUSTC=false CARGO=false \
  "$work/fresh/bin/pip" install -q --only-binary :all: "$wheel" pytest mypy || skip "numpy or pytest cannot be had"
# For the example with pictures alone: its test is left out where it cannot be had.
"$work/fresh/bin/pip" install -q --only-binary :all: matplotlib || {
  echo "SKIPPED: the notebook of examples/python; matplotlib cannot be had"
  echo "the notebook of examples/python: matplotlib cannot be had" >> "${SVBRDF_SKIPPED:-/dev/null}"
}
cargo build --release --quiet --workspace --bin svbrdf
export SVBRDF_CLI=$target/release/svbrdf
cd ffi/python
"$work/fresh/bin/python" -m pytest -q -p no:cacheprovider "$@"
"$work/fresh/bin/python" -m mypy --strict --cache-dir "$work/mypy" --package svbrdf
# PyO3 adds a list of names by itself.
"$work/fresh/bin/python" -m mypy.stubtest svbrdf --mypy-config-file pyproject.toml \
  --allowlist <(echo 'svbrdf\._native\.__all__')
