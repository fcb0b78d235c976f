"""Pack a folder of materials into one tar file of limited size, to be sent to another machine.

    bundle.py --materials FOLDER --out materials.tar [--megabytes 44] [--licences permissive]

Images become JPEG at the highest quality of a few at which the file keeps the limit;
sides and names stay, and manifest.csv has the rows of what is inside. data.py
reads the folder that the tar file is unpacked to.
"""

import argparse
import csv
import io
import os
import tarfile

from PIL import Image

from data import list_materials

MAPS = ("normal", "diffuse", "specular", "roughness")
QUALITIES = (95, 90, 85, 80, 75)


def encoded(path, quality):
    """An image file as JPEG, the smaller of the file itself and a new one."""
    with open(path, "rb") as f:
        original = f.read()
    image = Image.open(io.BytesIO(original))
    out = io.BytesIO()
    image.convert("L" if image.mode == "L" else "RGB").save(out, "JPEG", quality=quality, optimize=True)
    keep = image.format == "JPEG" and len(original) <= out.tell()
    return original if keep else out.getvalue()


def bundled(materials, names, quality):
    """Files of the materials ``names``: path in the tar file -> bytes."""
    files = {}
    for name in names:
        for stem in MAPS:
            found = [e for e in ("png", "jpg", "jpeg") if os.path.exists(os.path.join(materials, name, f"{stem}.{e}"))]
            if not found:
                raise SystemExit(f"{materials}/{name}: no image {stem}")
            files[f"{name}/{stem}.jpg"] = encoded(os.path.join(materials, name, f"{stem}.{found[0]}"), quality)
    return files


def manifest(materials, names):
    """The rows of manifest.csv of the materials ``names``, or None without one."""
    path = os.path.join(materials, "manifest.csv")
    if not os.path.exists(path):
        return None
    with open(path, newline="") as f:
        reader = csv.DictReader(f)
        rows = [r for r in reader if r["id"] in names]
    out = io.StringIO()
    writer = csv.DictWriter(out, reader.fieldnames, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue().encode()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--materials", default=os.environ.get("SVBRDF_MATERIALS"), required="SVBRDF_MATERIALS" not in os.environ)
    parser.add_argument("--out", required=True, help="tar file to write")
    parser.add_argument("--megabytes", type=float, default=44, help="limit of its size")
    parser.add_argument("--licences", choices=("all", "permissive"), default="all")
    args = parser.parse_args()
    names = [row[0] for row in list_materials(args.materials, args.licences)]
    for quality in QUALITIES:
        files = bundled(args.materials, names, quality)
        # 512 bytes of header, and padding to as many
        size = sum(len(data) + 1024 for data in files.values()) / 1e6
        if size <= args.megabytes:
            break
    else:
        raise SystemExit(f"{size:.1f} MB at quality {quality}, more than {args.megabytes:g}")
    table = manifest(args.materials, set(names))
    if table is not None:
        files["manifest.csv"] = table
    with tarfile.open(args.out, "w") as tar:
        for path, data in files.items():
            entry = tarfile.TarInfo(path)
            entry.size = len(data)
            tar.addfile(entry, io.BytesIO(data))
    print(f"{len(names)} materials, {os.path.getsize(args.out) / 1e6:.1f} MB, JPEG quality at most {quality}")


if __name__ == "__main__":
    main()
