#!/usr/bin/env bash
# Writes what has to go with a binary, or is asked for by those who take it:
#
#   ffi/packaging/notices.sh FOLDER [TARGET]
#
# FOLDER gets THIRD-PARTY.txt (licences and copyrights of all that is linked; cargo-about) and
# svbrdf.cdx.json, svbrdf-cli.cdx.json (software bills of materials of library and command line in
# CycloneDX's format; cargo-cyclonedx), for this platform or the target. Texts are those in the sources
# of the dependencies, as cargo has them: nothing is asked of a network.
set -euo pipefail
if [ $# -lt 1 ]; then
  sed -n '2,9s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
mkdir -p "$1"
target=${2:-$(rustc -vV | sed -n "s/^host: //p")}
out=$(cd "$1" && pwd)
cd "$(dirname "$0")/../.."
for tool in cargo-about cargo-cyclonedx; do
  command -v "$tool" >/dev/null || { echo "$tool is missing: cargo install --locked $tool (cargo-about: --features cli)" >&2; exit 1; }
done
# Both crates that ship; what they share is listed once.
cargo about generate --locked --offline --fail --workspace --target "$target" -c ffi/packaging/about.toml \
  -o "$out/THIRD-PARTY.txt" ffi/packaging/about.hbs
# It writes beside the manifests of all crates.
trap 'find . -path ./target -prune -o -name "*.svbrdf-sbom.json" -exec rm {} +' EXIT
for crate in ffi cli; do
  cargo cyclonedx --quiet --format json --target "$target" --override-filename bill.svbrdf-sbom \
    --manifest-path "$crate/Cargo.toml"
done
mv ffi/bill.svbrdf-sbom.json "$out/svbrdf.cdx.json"
mv cli/bill.svbrdf-sbom.json "$out/svbrdf-cli.cdx.json"
ls -l "$out"
