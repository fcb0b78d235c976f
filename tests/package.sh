#!/usr/bin/env bash
# Packs the crates as the registry would get them, and checks each pack: its size, licences, and that
# pictures of its README are in it.
#
#   tests/package.sh               seconds; needs no network once the workspace has been built
#   tests/package.sh build [DIR]   also builds the command from the packs alone, linked statically,
#                                  and lets it fit a capture: a cold build, its files in DIR
set -euo pipefail
cd "$(dirname "$0")/.."
crates=(svbrdf-models svbrdf svbrdf-cli)
# The registry takes 10 MiB.
limit=10000000
version=$(sed -n '/^\[workspace.package\]/,/^$/s/^version = "\(.*\)"$/\1/p' Cargo.toml)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

pack() {
  cargo package --quiet --no-verify --allow-dirty "$@" --target-dir "$work" \
    "${crates[@]/#/--package=}" 2> "$work/said"
}
pack --offline || pack || { cat "$work/said" >&2; exit 1; }

fault() { echo "$1" >&2; faults=1; }
faults=0
for crate in "${crates[@]}"; do
  tar -xzf "$work/package/$crate-$version.crate" -C "$work"
  folder=$work/$crate-$version
  bytes=$(stat -c %s "$work/package/$crate-$version.crate")
  echo "$crate $version: $bytes bytes packed"
  [ "$bytes" -le "$limit" ] || fault "$crate packs to $bytes bytes; at most $limit are allowed"
  for file in README.md LICENSE-MIT LICENSE-APACHE; do
    [ -s "$folder/$file" ] || fault "$crate: no $file in the pack"
  done
done
# Pages that show the README without its repository find its pictures in the pack.
pictures=$(grep -o '!\[[^]]*\]([^)]*)' "$work/svbrdf-$version/README.md" | sed 's/.*(\(.*\))/\1/')
[ -n "$pictures" ] || fault "README.md has no pictures: this check is out of date"
for picture in $pictures; do
  [ -f "$work/svbrdf-$version/$picture" ] || fault "svbrdf: $picture of its README is not in the pack"
done
# A path without version would keep a crate from the registry.
for crate in "${crates[@]}"; do
  if grep -n '^path = "\.\.' "$work/$crate-$version/Cargo.toml"; then
    fault "$crate: the packed manifest names a folder of the repository"
  fi
done
[ "$faults" = 0 ] || exit 1
[ "${1:-}" = build ] || { echo "packages: all fine"; exit 0; }

# A workspace of the packs; they stand in for the registry's crates, nothing of the repository does.
place=${2:-${CARGO_TARGET_DIR:-$PWD/target}/packed}
rm -rf "$place/crates"
mkdir -p "$place/crates"
for crate in "${crates[@]}"; do
  mv "$work/$crate-$version" "$place/crates/$crate"
done
cp Cargo.lock "$place/crates"
cat > "$place/crates/Cargo.toml" <<EOF
[workspace]
members = ["svbrdf", "svbrdf-cli", "svbrdf-models"]
resolver = "3"

[patch.crates-io]
svbrdf = { path = "svbrdf" }
svbrdf-models = { path = "svbrdf-models" }

EOF
# Cargo takes profiles from the workspace alone.
sed -n '/^\[profile\./,$p' Cargo.toml >> "$place/crates/Cargo.toml"
(cd "$place/crates" && CARGO_TARGET_DIR=$place/target \
  cargo rustc --release --package svbrdf-cli --bin svbrdf -- -C target-feature=+crt-static)
built=$place/target/release/svbrdf
if ldd "$built" 2>&1 | grep -q '=>'; then
  echo "$built is not linked statically" >&2
  exit 1
fi
"$built" fit "$place/crates/svbrdf/examples/captures/tile" --frames 2 --steps 10 --quiet --out "$work/maps"
[ -s "$work/maps/normal.png" ]
echo "packages: all fine; $built made maps"
