#!/usr/bin/env bash
# Looks at report.html in Debian's Chromium: the viewer against `svbrdf render`, dragging, keys, the
# slider, accessibility, and that nothing is loaded. Needs node, npm and Chromium; installs what is
# missing of them and says SKIPPED where it cannot. With a folder as argument, pictures of the page
# are left there.
set -euo pipefail
cd "$(dirname "$0")/.."
skip() {
  echo "SKIPPED: report.html is not looked at in a browser: $1"
  echo "report.html in a browser" >> "${SVBRDF_SKIPPED:-/dev/null}"
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
tools=$folder/report-tools
mkdir -p "$tools"
[ -d "$tools/node_modules/playwright-core" ] && [ -d "$tools/node_modules/pngjs" ] &&
  [ -d "$tools/node_modules/axe-core" ] ||
  # Later ones of the first refuse Debian 12's Node.
  npm install --silent --no-audit --no-fund --prefix "$tools" playwright-core@1.61 pngjs axe-core ||
  skip "playwright-core, pngjs and axe-core cannot be installed"

[ -x "$folder/release/svbrdf" ] || cargo build --quiet --release -p svbrdf-cli --bin svbrdf
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$folder/release/svbrdf" fit examples/captures/tile --out "$work/maps" --steps 6 --hold-out 2 --quiet
NODE_PATH="$tools/node_modules" node tests/report/look.cjs "$folder/release/svbrdf" "$work/maps" "$(command -v chromium)" "$@"
