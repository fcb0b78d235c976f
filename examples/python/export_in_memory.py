"""Turns a folder of maps into files of other programs, in memory.

    python export_in_memory.py MAPS"""

from __future__ import annotations

import sys

import svbrdf


def run(folder: str) -> dict[str, bytes]:
    """Bytes of the files by name."""
    maps = svbrdf.Maps.load(folder, sample_mm=(88, 88))
    files = maps.package(["glb", "unreal"], max_size=128)
    for name, content in files.items():
        print(f"{name}: {len(content)} bytes")
    return files


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    run(sys.argv[1])
