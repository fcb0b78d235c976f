#!/usr/bin/env bash
# Builds the web page and uses it in Debian's Chromium: the example's maps against the command
# line's, photographs without a description, bad and very large pictures, downloads, a lost worker,
# a stopped page, use without a network, a phone's width, accessibility; no console error, no request
# to anywhere else. Needs node, npm and Chromium; installs those that are missing, and says SKIPPED if
# it cannot. With a folder as argument, pictures of the page are left there. Not part of
# tests/run.sh: the first build takes longer than all other checks.
set -euo pipefail
cd "$(dirname "$0")/.."
. tests/tools.sh
folder=${CARGO_TARGET_DIR:-target}
tools=$folder/web-tests
has "the web page in a browser" npm nodejs npm || exit 0
has "the web page in a browser" chromium chromium fonts-dejavu-core || exit 0
modules "the web page in a browser" "$tools" "$PLAYWRIGHT" axe-core gltf-validator || exit 0

ffi/web/build.sh
cargo build --quiet --release --workspace --bin svbrdf
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
NODE_PATH="$tools/node_modules" node tests/web/use.cjs "$folder/release/svbrdf" "$work" "$(command -v chromium)" "$@"
