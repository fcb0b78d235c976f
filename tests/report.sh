#!/usr/bin/env bash
# Looks at report.html in Debian's Chromium: the viewer against `svbrdf render`, dragging, keys, the
# slider, accessibility, and that nothing is loaded. Needs node, npm and Chromium; installs those that
# are missing, and says SKIPPED if it cannot. With a folder as argument, pictures of the page
# are left there.
set -euo pipefail
cd "$(dirname "$0")/.."
. tests/tools.sh
folder=${CARGO_TARGET_DIR:-target}
tools=$folder/report-tools
has "report.html in a browser" npm nodejs npm || exit 0
has "report.html in a browser" chromium chromium fonts-dejavu-core || exit 0
modules "report.html in a browser" "$tools" "$PLAYWRIGHT" pngjs axe-core || exit 0

[ -x "$folder/release/svbrdf" ] || cargo build --quiet --release --workspace --bin svbrdf
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$folder/release/svbrdf" fit examples/captures/tile --out "$work/maps" --steps 6 --hold-out 2 --quiet
NODE_PATH="$tools/node_modules" node tests/report/look.cjs "$folder/release/svbrdf" "$work/maps" "$(command -v chromium)" "$@"
