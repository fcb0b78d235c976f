#!/usr/bin/env python3
"""Packs the extension with wheels for one or several systems: build.py OUT.zip WHEEL...

The wheels have to be of the extension's version; systems without one are left out of the manifest. They are packed
as they are, byte by byte. Blender's extension platform takes wheels of the Python index alone:

    pip download --no-deps --only-binary :all: --platform manylinux_2_28_x86_64 -d wheels svbrdf==VERSION

The add-on is GPL-3.0-or-later, as the platform and Blender's Python interface ask; the wheels keep their licences."""
import pathlib
import sys
import tomllib
import zipfile

HERE = pathlib.Path(__file__).resolve().parent
#: What the name of a wheel ends with, and what Blender calls that system.
SYSTEMS = {
    ("linux", "x86_64"): "linux-x64",
    ("win", "amd64"): "windows-x64",
    ("win", "arm64"): "windows-arm64",
    ("macosx", "arm64"): "macos-arm64",
    ("macosx", "x86_64"): "macos-x64",
}


def system(wheel):
    """Blender's name of a wheel's system."""
    tag = wheel.stem.split("-")[-1]
    for (kind, processor), name in SYSTEMS.items():
        if processor in tag and kind in tag:
            return name
    sys.exit(f"{wheel.name}: no system that Blender runs on")


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    out, wheels = pathlib.Path(sys.argv[1]), [pathlib.Path(path) for path in sys.argv[2:]]
    folder = HERE / "extension"
    manifest = (folder / "blender_manifest.toml").read_text()
    version = tomllib.loads(manifest)["version"]
    for wheel in wheels:
        if not wheel.name.startswith(f"svbrdf-{version}-"):
            sys.exit(f"{wheel.name}: svbrdf-{version} expected")
    listed = ", ".join(f'"./wheels/{wheel.name}"' for wheel in wheels)
    systems = ", ".join(f'"{system(wheel)}"' for wheel in wheels)
    # Before the first table: keys after it would belong to it.
    head, bracket, tables = manifest.partition("\n[permissions]")
    manifest = f"{head}platforms = [{systems}]\nwheels = [{listed}]\n{bracket}{tables}"
    tomllib.loads(manifest)
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("blender_manifest.toml", manifest)
        archive.write(folder / "LICENSE", "LICENSE")
        for source in sorted(folder.glob("*.py")):
            archive.write(source, source.name)
        for wheel in wheels:
            archive.write(wheel, f"wheels/{wheel.name}", zipfile.ZIP_STORED)
    print(f"{out}: {out.stat().st_size // 1024} KiB")


main()
