#!/usr/bin/env bash
# Exports uniform materials and given folders of maps, and renders each with the library for
# every view of views.json: cases.sh SVBRDF OUT [MAPS...]
set -euo pipefail
svbrdf=$1 out=$2
shift 2
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$out"
node "$here/materials.mjs" "$out.maps"
for maps in "$out".maps/* "$@"; do
  name=$(basename "${maps%/truth}")
  "$svbrdf" export "$maps" --format glb,usdz,materialx,blender --sample-mm 100 --out "$out/$name"
  node -e '
    const views = JSON.parse(require("fs").readFileSync(process.argv[1]));
    for (const { camera, light } of views) console.log(camera.join(), light.join());
  ' "$here/views.json" | {
    index=0
    while read -r camera light; do
      "$svbrdf" render "$maps" --camera-mm="$camera" --light-mm="$light" --out "$out/$name/$index.exr"
      index=$((index + 1))
    done
  }
done
