#!/usr/bin/env bash
# Builds the web page and uses it in Debian's Chromium: the example's maps against the command
# line's, both libraries (with and without fused multiply-add) against each other, photographs without a description and
# in HEIC, bad and very large pictures, downloads, a lost worker, a stopped page, use without a network after one visit,
# a phone's width and home screen, accessibility; no console error, no request to anywhere else.
#
#   tests/web.sh [PICTURES]       with a folder, pictures of the page are left there
#   tests/web.sh speed [RUNS]     instead: a photograph of the example in the page and by the command line, times
#
# Needs node, npm, Chromium and libheif's encoder; installs those that are missing and says SKIPPED where it cannot. Not
# part of tests/run.sh: the first build takes longer than all other checks.
set -euo pipefail
cd "$(dirname "$0")/.."
. tests/tools.sh
folder=${CARGO_TARGET_DIR:-target}
tools=$(realpath -m "$folder/web-tests")
has "the web page in a browser" npm nodejs npm || exit 0
has "the web page in a browser" chromium chromium fonts-dejavu-core || exit 0
modules "the web page in a browser" "$tools" "$PLAYWRIGHT" axe-core gltf-validator || exit 0
HEIC=0
has "HEIC in the web page" heif-enc libheif-examples && HEIC=1
export HEIC

ffi/web/build.sh
cargo build --quiet --release --workspace --bin svbrdf
export NODE_PATH=$tools/node_modules
if [ "${1:-}" = speed ]; then
  node tests/web/speed.cjs "$folder/release/svbrdf" "$(command -v chromium)" "${@:2}"
  exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
node tests/web/use.cjs "$folder/release/svbrdf" "$work" "$(command -v chromium)" "$@"
