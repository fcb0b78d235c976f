"""Adds photographs until the roughness is known well enough.

    python uncertainty.py CAPTURE DEVIATION [PHOTOGRAPHS]"""

from __future__ import annotations

import sys

import numpy as np
import svbrdf


def run(folder: str, enough: float, most: int | None = None) -> list[float]:
    """The standard deviation of the roughness after each photograph."""
    capture = svbrdf.Capture.load(folder)
    known: list[float] = []
    with svbrdf.Session.of_capture(capture) as session:
        for file in capture.photos[:most]:
            if not session.add_photo(file.read()):
                continue
            # Deviations are meaningful once the fit has settled.
            session.wait()
            deviations = session.snapshot_with_uncertainty().deviations
            assert deviations is not None
            roughness = deviations["roughness"]
            known.append(float(np.sqrt(np.mean(roughness**2))))
            unknown = np.mean(roughness > enough)
            print(f"roughness within {known[-1]:.3f}, {unknown:.0%} of the texels not within {enough}")
            if known[-1] <= enough:
                break
    return known


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    run(sys.argv[1], float(sys.argv[2]), *map(int, sys.argv[3:4]))
