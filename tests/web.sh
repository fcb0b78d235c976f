#!/usr/bin/env bash
# Builds the web page and uses it in Debian's Chromium: the example's maps against the command
# line's, photographs without a description, bad pictures, downloads, a lost worker, use without a
# network, a phone's width, accessibility; no console error, no request to anywhere else. Needs node,
# npm and Chromium; installs what is missing of them and says SKIPPED where it cannot. With a folder
# as argument, pictures of the page are left there. The first build takes many minutes.
set -euo pipefail
cd "$(dirname "$0")/.."
skip() {
  echo "SKIPPED: the web page is not used in a browser: $1"
  echo "the web page in a browser" >> "${SVBRDF_SKIPPED:-/dev/null}"
  exit 0
}

packages=()
command -v npm >/dev/null || packages+=(nodejs npm)
command -v chromium >/dev/null || packages+=(chromium fonts-dejavu-core)
if [ ${#packages[@]} -gt 0 ]; then
  sudo=$([ "$(id -u)" = 0 ] || echo sudo)
  { $sudo apt-get update -q &&
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qy --no-install-recommends "${packages[@]}"; } ||
    skip "${packages[*]} cannot be installed"
fi
folder=${CARGO_TARGET_DIR:-target}
tools=$folder/web-tests
mkdir -p "$tools"
[ -d "$tools/node_modules/playwright-core" ] && [ -d "$tools/node_modules/gltf-validator" ] &&
  [ -d "$tools/node_modules/axe-core" ] ||
  # Later ones of the first refuse Debian 12's Node.
  npm install --silent --no-audit --no-fund --prefix "$tools" playwright-core@1.61 axe-core gltf-validator ||
  skip "playwright-core, axe-core and gltf-validator cannot be installed"

ffi/web/build.sh
[ -x "$folder/release/svbrdf" ] || cargo build --quiet --release -p svbrdf-cli --bin svbrdf
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
NODE_PATH="$tools/node_modules" node tests/web/use.cjs "$folder/release/svbrdf" "$work" "$(command -v chromium)" "$@"
