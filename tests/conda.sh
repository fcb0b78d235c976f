#!/usr/bin/env bash
# The recipe for conda, as a release writes it, by the parser and the rules of rattler-build (py-rattler-build of PyPI): the
# checksum is that of the archive beside it, all variables have values, and the archive has what the recipe names. By hand;
# conda's channels are not asked, so nothing is built.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=${CARGO_TARGET_DIR:-$PWD/target}/conda-tools
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
if ! "$tools/bin/python" -c 'import rattler_build' 2>/dev/null; then
  python3 -m venv "$tools" && "$tools/bin/pip" install -q py-rattler-build ||
    { echo "SKIPPED: the recipe for conda; py-rattler-build cannot be had"; exit 0; }
fi
ffi/packaging/release.sh "$work" source > /dev/null
"$tools/bin/python" - "$work" <<'END'
import hashlib, pathlib, sys, tarfile

import rattler_build

folder = pathlib.Path(sys.argv[1])
(archive,), (recipe,) = folder.glob("*.tar.gz"), folder.glob("*-conda.yaml")
variants = rattler_build.VariantConfig(
    {"c_compiler": ["gcc"], "rust_compiler": ["rust"], "c_stdlib": ["sysroot"], "c_stdlib_version": ["2.17"], "python": ["3.12.*"]}
)
(rendered,) = rattler_build.Stage0Recipe.from_yaml(recipe.read_text()).render(variants)
found = rendered.recipe.to_dict()
(source,) = found["source"]
assert source["sha256"] == hashlib.sha256(archive.read_bytes()).hexdigest(), source
assert source["url"].endswith(archive.name), source
assert {"build", "host", "run"} <= set(found["requirements"]), found
names = {name.split("/", 1)[1] for name in tarfile.open(archive).getnames() if "/" in name}
for needed in ("ffi/python/pyproject.toml", "Cargo.lock", "models/decoder.bin", "examples/captures/tile/capture.json", "LICENSE-MIT", "LICENSE-APACHE"):
    assert needed in names, needed
print(f"conda: the recipe renders as {rendered.recipe.package.name} {rendered.recipe.package.version}, its checksum is that of {archive.name}")
END
