#!/usr/bin/env bash
# The container image of cli/batch/image.sh in the OCI runtimes of Debian (crun, runc): another user, a root that cannot be
# written, no network, no capabilities, a limit of memory. By hand.
#
#   tests/image.sh [IMAGE.tar]      else the image is built, with a statically linked command, in minutes
#
# Installs Debian's crun, runc, buildah and busybox-static when missing; needs root.
set -euo pipefail
image=${1:+$(realpath "$1")}
cd "$(dirname "$0")/.."
. tests/tools.sh
for tool in crun runc buildah busybox; do
  package=$tool
  [ $tool != busybox ] || package=busybox-static
  has "the container image" $tool "$package" || exit 0
done
[ "$(id -u)" = 0 ] || { echo "tests/image.sh needs root" >&2; exit 1; }
# crun refuses machines with both versions of control groups: without the second, in a mount namespace of this script.
if [ -z "${SVBRDF_ONE_HIERARCHY:-}" ] && mountpoint -q /sys/fs/cgroup/unified; then
  export SVBRDF_ONE_HIERARCHY=1
  exec unshare --mount bash -c 'umount /sys/fs/cgroup/unified && exec "$@"' bash "$PWD/tests/image.sh" ${image:+"$image"}
fi
fail() { echo "FAILED: $*" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
if [ -z "$image" ]; then
  image=$work/image.tar
  cli/batch/image.sh "$image"
fi

# The root folder, and the image's description of its process.
mkdir "$work/image" "$work/bundle" "$work/bundle/rootfs"
tar -xf "$image" -C "$work/image"
python3 - "$work" <<'END'
import json, pathlib, subprocess, sys

work = pathlib.Path(sys.argv[1])
blob = lambda entry: work / "image/blobs" / entry["digest"].replace(":", "/")
manifest = json.loads(blob(json.loads((work / "image/index.json").read_text())["manifests"][0]).read_text())
for layer in manifest["layers"]:
    subprocess.run(["tar", "-xf", blob(layer), "-C", work / "bundle/rootfs"], check=True)
stated = json.loads(blob(manifest["config"]).read_text())["config"]
assert stated["User"] == "65534:65534", "the image starts as nobody"
(work / "stated.json").write_text(json.dumps(stated))
END

# Captures as anybody's, maps for one user only.
captures=$work/data/captures
uid=10001
for i in 0 1; do
  "$work/bundle/rootfs/bin/svbrdf" simulate examples/captures/tile/truth --out "$captures/$i" --frames 2 --seed $i --rectified --quiet 2> /dev/null ||
    "$work/bundle/rootfs/bin/svbrdf" simulate examples/captures/tile/truth --out "$captures/$i" --frames 2 --seed $i --rectified > /dev/null
done
mkdir "$captures/faulty" "$work/data/maps"
chown -R $uid:$uid "$work/data/maps"
chmod 755 "$work" "$work/data"

# container RUNTIME MIB ARGUMENT...: the image's entry point with arguments, or a command of it after `--`.
container() {
  local runtime=$1 mib=$2
  shift 2
  python3 - "$work" "$uid" "$mib" "$@" <<'END'
import json, pathlib, sys

work, uid, mib, arguments = pathlib.Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]
stated = json.loads((work / "stated.json").read_text())
command = arguments[1:] if arguments[0] == "--" else stated["Entrypoint"] + arguments
tmpfs = ["nosuid", "nodev", "mode=1777", "size=64m"]
config = {
    "ociVersion": "1.0.2",
    "process": {
        "user": {"uid": uid, "gid": uid}, "args": command, "cwd": "/", "noNewPrivileges": True,
        "env": [*stated["Env"], "SVBRDF_JOBS=2"],
        "capabilities": {kind: [] for kind in ("bounding", "effective", "permitted", "inheritable", "ambient")},
    },
    "root": {"path": "rootfs", "readonly": True},
    "mounts": [
        {"destination": "/proc", "type": "proc", "source": "proc"},
        {"destination": "/tmp", "type": "tmpfs", "source": "tmpfs", "options": tmpfs},
        {"destination": "/dev", "type": "tmpfs", "source": "tmpfs", "options": ["nosuid", "mode=755", "size=64k"]},
        {"destination": "/data/captures", "type": "bind", "source": str(work / "data/captures"), "options": ["rbind", "ro"]},
        {"destination": "/data/maps", "type": "bind", "source": str(work / "data/maps"), "options": ["rbind", "rw"]},
    ],
    "linux": {
        "namespaces": [{"type": kind} for kind in ("pid", "network", "ipc", "uts", "mount")],
        "resources": {"memory": {"limit": mib << 20}, "devices": [{"allow": False, "access": "rwm"}]},
    },
}
(work / "bundle/config.json").write_text(json.dumps(config, indent=1))
END
  "$runtime" --root "$work/state" run --bundle "$work/bundle" "svbrdf-$$-$RANDOM"
}
expect() {
  local status=$1 is=0
  shift
  "$@" > "$work/said" 2>&1 || is=$?
  [ $is = "$status" ] || { cat "$work/said"; fail "status $is instead of $status: $*"; }
}

# Places for the mounts: the runtimes cannot make them in a root that is only read.
mkdir -p "$work"/bundle/rootfs/{proc,dev,data/captures,data/maps}
for runtime in crun runc; do
  expect 2 container $runtime 1024 /data/captures /data/maps --steps 8 --no-report
  grep -q '2 of 3 captures are done, 1 are at fault' "$work/said" || { cat "$work/said"; fail "$runtime: its last line"; }
  for i in 0 1; do
    [ "$(stat -c %u "$work/data/maps/$i/normal.png")" = $uid ] || fail "$runtime: maps are another user's"
  done
  echo "$runtime: fits as user $uid"
  expect 1 container $runtime 1024 -- sh -c 'echo > /written'
  grep -qi 'read-only' "$work/said" || { cat "$work/said"; fail "$runtime: the root can be written"; }
  expect 0 container $runtime 1024 -- sh -c 'cat /proc/net/dev | grep -c : | grep -x 1 && grep -c . /proc/net/route | grep -x 1'
  expect 0 container $runtime 1024 -- grep -qx "CapEff:.0000000000000000" /proc/self/status
  echo "$runtime: the root is only read, there is no network and no capability"
  rm -rf "$work"/data/maps/*
  expect 1 container $runtime 60 /data/captures /data/maps --steps 8 --no-report
  grep -q '0 of 3 captures are done' "$work/said" || { cat "$work/said"; fail "$runtime: 60 MiB are no limit"; }
  grep -h 'status 137' "$work/said" | sed "s/^/$runtime, 60 MiB: /"
  rm -rf "$work"/data/maps/*
done
echo "image: all fine"
