#!/usr/bin/env bash
# Builds the web page and uses it in Debian's Chromium: the example's maps against the command
# line's, photographs without a description, bad and very large pictures, downloads, a lost worker,
# a stopped page, use without a network, a phone's width, accessibility; no console error, no request
# to anywhere else. Needs node, npm and Chromium; installs what is missing of them and says SKIPPED where
# it cannot. With a folder as argument, pictures of the page are left there. Not part of
# tests/run.sh: the first build takes longer than all other checks.
set -euo pipefail
cd "$(dirname "$0")/.."
. tests/tools.sh
leave() {
  skip "the web page in a browser: $1"
  exit 0
}
has "the web page in a browser" npm nodejs npm || exit 0
has "the web page in a browser" chromium chromium fonts-dejavu-core || exit 0
folder=${CARGO_TARGET_DIR:-target}
tools=$folder/web-tests
mkdir -p "$tools"
[ -d "$tools/node_modules/playwright-core" ] && [ -d "$tools/node_modules/gltf-validator" ] &&
  [ -d "$tools/node_modules/axe-core" ] ||
  # Later ones of the first refuse Debian 12's Node.
  npm install --silent --no-audit --no-fund --prefix "$tools" playwright-core@1.61 axe-core gltf-validator ||
  leave "playwright-core, axe-core and gltf-validator cannot be installed"

ffi/web/build.sh
cargo build --quiet --release -p svbrdf-cli --bin svbrdf
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
NODE_PATH="$tools/node_modules" node tests/web/use.cjs "$folder/release/svbrdf" "$work" "$(command -v chromium)" "$@"
