"""The loop of a camera app: judge the preview, add the photograph, show the maps and the next view.

    python live_loop.py CAPTURE [PHOTOGRAPHS]

The photographs of a folder with ``capture.json`` stand for the camera. Only the end waits for the fit."""

from __future__ import annotations

import sys

import svbrdf


def run(folder: str, most: int | None = None) -> int:
    """The number of photographs used."""
    capture = svbrdf.Capture.load(folder)
    with svbrdf.Session.of_capture(capture) as session:
        for file in capture.photos[:most]:
            image = file.read()
            # An image of the preview, usually a smaller one. A probe changes nothing.
            probe = session.probe(image)
            if probe.rejection is not None:
                print("not yet:", probe.rejection.message)
                continue
            outcome = session.add_photo(image)
            if isinstance(outcome, svbrdf.Rejected):
                print("try again:", outcome.message)
                continue
            print(f"photograph {outcome.index + 1} is in the maps")
            # The fit continues; its maps are there at any time.
            maps = session.snapshot()
            print(f"  maps of {maps.size[0]} x {maps.size[1]} texels")
            view = session.next_view()
            if view is not None:
                print(f"  next: {view.tilt_deg:.0f} degrees off the vertical, towards {view.azimuth_deg:.0f} degrees")
        session.wait()
        return session.progress.photos


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    print(run(sys.argv[1], *map(int, sys.argv[2:3])), "photographs used")
