"""Maps from arrays of photographs that are rectified already, each with the positions of camera and light.

    python rectified.py

The photographs are rendered from known maps, with which the result is compared."""

from __future__ import annotations

import numpy as np
import svbrdf

SIDE = 256
SAMPLE_MM = (100.0, 100.0)
#: Camera and flash above the sample, mm.
PLACES = [(0.0, 0.0, 150.0), (60.0, 0.0, 140.0), (-50.0, 50.0, 140.0)]


def run() -> float:
    """Root mean square error of the diffuse albedo."""
    normal = np.zeros((SIDE, SIDE, 3), np.float32)
    normal[..., 2] = 1
    stripes = (np.arange(SIDE)[:, None] // 32 + np.arange(3)) % 2 == 0
    diffuse = np.broadcast_to(np.where(stripes, 0.4, 0.15), (SIDE, SIDE, 3)).astype(np.float32)
    specular = np.full((SIDE, SIDE, 3), 0.04, np.float32)
    roughness = np.full((SIDE, SIDE), 0.6, np.float32)
    truth = svbrdf.Maps.from_arrays(normal, diffuse, specular, roughness, sample_mm=SAMPLE_MM)
    with svbrdf.Session.rectified(sample_mm=SAMPLE_MM, falloff="none") as session:
        for place in PLACES:
            # An array of linear floats, rows by columns by RGB.
            pixels = truth.render(camera_mm=place, light_mm=place)
            outcome = session.add_rectified_photo(svbrdf.Photo(pixels), camera_mm=place, light_mm=place)
            print(f"camera at {place} mm:", "used" if outcome else outcome)
        session.wait()
        maps = session.snapshot()
    error = float(np.sqrt(np.mean((maps.diffuse - truth.diffuse) ** 2)))
    print(f"diffuse albedo off by {error:.4f}")
    return error


if __name__ == "__main__":
    run()
