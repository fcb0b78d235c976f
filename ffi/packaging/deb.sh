#!/usr/bin/env bash
# Makes the Debian packages of library, headers and command line, and of their debug information:
#
#   ffi/packaging/deb.sh OUT [PROFILE]      profile: dist-debug (default) or another
#
# Needs cargo-deb, dpkg-dev and what notices.sh needs. SVBRDF_MAINTAINER: "Name <address>".
# SVBRDF_BUILT: not empty: the profile has been built. SVBRDF_NOTICES: a folder of notices.sh.
set -euo pipefail
if [ $# -lt 1 ]; then
  sed -n '2,7s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
mkdir -p "$1"
out=$(cd "$1" && pwd)
profile=${2:-dist-debug}
root=$(cd "$(dirname "$0")/../.." && pwd)
cd "$root"
built=${CARGO_TARGET_DIR:-$root/target}/$profile
[ -n "${SVBRDF_BUILT:-}" ] ||
  cargo build --locked --profile "$profile" -p svbrdf-ffi -p svbrdf-cli

# What the packages' lists of files name, below the folder of the profile.
stage=$built/deb
rm -rf "$stage"
DESTDIR=$stage SVBRDF_BUILT=$built ffi/install.sh /usr
if [ -n "${SVBRDF_NOTICES:-}" ]; then
  cp -r "$SVBRDF_NOTICES" "$stage/notices"
else
  ffi/packaging/notices.sh "$stage/notices"
fi
gzip -9nc CHANGELOG.md > "$stage/changelog.gz"

common=(--no-build --locked --profile "$profile" --output "$out/")
common+=(--maintainer "${SVBRDF_MAINTAINER:-svbrdf developers}")
cargo deb "${common[@]}" --dbgsym -p svbrdf-ffi
cargo deb "${common[@]}" -p svbrdf-ffi --variant dev
cargo deb "${common[@]}" --dbgsym -p svbrdf-cli
