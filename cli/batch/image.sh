#!/usr/bin/env bash
# Makes a container image of the command without a daemon and without rights (buildah):
#
#   image.sh OUT.tar [SVBRDF]     SVBRDF: a statically linked binary; else one is built
#
# OUT.tar is an OCI archive: `skopeo copy oci-archive:OUT.tar docker://REGISTRY/svbrdf:VERSION`. It holds
# the command, busybox (Debian: busybox-static; GPL-2, a program of its own) and fit-all.sh, which
# the image runs.
set -euo pipefail
if [ $# -lt 1 ]; then
  sed -n '2,8s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
out=$(realpath "$1")
here=$(cd "$(dirname "$0")" && pwd)
binary=${2:-}
if [ -z "$binary" ]; then
  cd "$here/../.."
  export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}/image
  cargo rustc --locked --release -p svbrdf-cli --bin svbrdf -- -C target-feature=+crt-static
  binary=$CARGO_TARGET_DIR/release/svbrdf
fi
binary=$(realpath "$binary")
busybox=$(command -v busybox) || { echo "busybox is missing (Debian: busybox-static)" >&2; exit 1; }
for program in "$binary" "$busybox"; do
  ! ldd "$program" 2>&1 | grep -q '=>' || { echo "$program is not linked statically" >&2; exit 1; }
done
version=$("$binary" --version | sed 's/.* //')

work=$(mktemp -d)
trap 'buildah unshare rm -rf "$work" 2>/dev/null || rm -rf "$work"' EXIT
mkdir -p "$work/files/bin" "$work/files/usr/share/doc/svbrdf"
install -m 755 "$busybox" "$work/files/bin/busybox"
for name in sh basename cat find grep mkdir mktemp nproc rm sed tail tr wc xargs; do
  ln -s busybox "$work/files/bin/$name"
done
install -m 755 "$binary" "$work/files/bin/svbrdf"
install -m 755 "$here/fit-all.sh" "$work/files/fit-all.sh"
mkdir -m 1777 "$work/files/tmp"
install -m 644 "$here"/../LICENSE-* "$work/files/usr/share/doc/svbrdf"

store=(buildah --root "$work/store" --runroot "$work/run" --storage-driver vfs)
container=$("${store[@]}" from scratch)
"${store[@]}" copy --quiet "$container" "$work/files" / >/dev/null
"${store[@]}" config --entrypoint '["/fit-all.sh"]' --env PATH=/bin --user 65534:65534 \
  --label org.opencontainers.image.version="$version" \
  --label org.opencontainers.image.licenses="MIT OR Apache-2.0" "$container"
"${store[@]}" commit --quiet --format oci "$container" svbrdf >/dev/null
rm -f "$out"
"${store[@]}" push --quiet svbrdf "oci-archive:$out:svbrdf:$version"
echo "$out: svbrdf:$version, $(stat -c %s "$out") bytes"
