# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that takes a while, on a thread of its own. Nothing here knows of Blender."""

import os
import threading
from dataclasses import dataclass, field


class SourceError(Exception):
    """There is nothing to read where the user pointed to."""


@dataclass(frozen=True)
class Request:
    """What is asked for."""

    #: Folder with photographs, or with maps.
    source: str
    #: Whether the source holds maps.
    is_maps: bool
    #: Folder below which the textures are written.
    folder: str
    #: Name of the material.
    name: str
    resolution: int = 512
    #: Width and height of the sample, mm; `None`: as stated by the source, or by its board.
    sample_mm: tuple | None = None
    #: Whether the maps are made seamless.
    tile: bool = False
    #: Options for tests: photographs and steps at most.
    photos: int | None = None
    steps: int | None = None


@dataclass
class Result:
    """What came of it."""

    #: The script that builds the nodes.
    script: str
    sample_mm: tuple
    #: What there is to tell, line by line.
    report: list = field(default_factory=list)


class Job:
    """A request being worked on. Its attributes may be read at any time."""

    def __init__(self, svbrdf, request):
        self._svbrdf, self._request = svbrdf, request
        self._cancelled = threading.Event()
        self._thread = threading.Thread(target=self._run, name="svbrdf", daemon=True)
        #: Share of the work that is done, 0 to 1, and what is being done.
        self.fraction, self.message = 0.0, "Starting"
        #: One of them is set in the end.
        self.result, self.error = None, None

    def start(self):
        self._thread.start()
        return self

    def cancel(self):
        """Ends the work soon: `error` becomes a `CancelledError`."""
        self._cancelled.set()

    @property
    def is_done(self):
        return not self._thread.is_alive()

    def wait(self, seconds=None):
        self._thread.join(seconds)
        return self.is_done

    def _run(self):
        try:
            self.result = self._work()
        except BaseException as fault:  # whatever it is, Blender goes on and shows it
            self.error = fault

    def _tell(self, fraction, message):
        self.fraction, self.message = fraction, message
        if self._cancelled.is_set():
            raise self._svbrdf.CancelledError("cancelled")

    def _work(self):
        request = self._request
        # Before minutes of work: textures will be written there.
        os.makedirs(request.folder, exist_ok=True)
        folder = _unused(os.path.join(request.folder, _file_name(request.name)))
        os.mkdir(folder)
        try:
            maps = self._read() if request.is_maps else self._fit()
            self._tell(0.95, "Writing textures")
            maps.export(folder, ["blender"], tile=request.tile, texture="png16")
            self._tell(1.0, "Done")
        except BaseException:
            _remove_if_empty(folder)
            raise
        script = os.path.join(folder, "blender", "material.py")
        return Result(script, maps.sample_mm, _report(maps))

    def _read(self):
        self._tell(0.0, "Reading maps")
        request = self._request
        if not os.path.isdir(request.source):
            raise SourceError(f"{request.source or 'Maps'}: there is no such folder")
        return self._svbrdf.Maps.load(request.source, sample_mm=request.sample_mm)

    def _fit(self):
        self._tell(0.0, "Reading photographs")
        request = self._request
        options = {"resolution": request.resolution, "photos": request.photos, "steps": request.steps}
        source = request.source
        if not os.path.isdir(source):
            raise SourceError(f"{source or 'Photographs'}: there is no such folder")
        if not os.path.isfile(os.path.join(source, "capture.json")):
            options["sample_mm"] = request.sample_mm

        def tell(progress):
            left = "" if progress.seconds_left is None else f", {progress.seconds_left:.0f} s left"
            what = f"Photo {progress.photo} of {progress.photos}{left}"
            self._tell(0.95 * progress.fraction, what)

        return self._svbrdf.fit(source, on_progress=tell, **options)


def _report(maps):
    lines = []
    used = sum(photograph.accepted for photograph in maps.photos)
    if maps.photos:
        lines.append(f"{used} of {len(maps.photos)} photographs used")
    for photograph in maps.photos:
        name = os.path.basename(str(photograph.source))
        if not photograph.accepted:
            lines.append(f"{name}: {photograph.message}")
        lines.extend(f"{name}: {hint.message}" for hint in photograph.hints)
    height, width = maps.size
    x, y = maps.sample_mm
    lines.append(f"{width} x {height} texels, {x:g} x {y:g} mm")
    return lines


def _file_name(name):
    kept = "".join(c if c.isalnum() or c in "-_ " else "_" for c in name).strip()
    return kept or "svbrdf"


def _unused(path):
    """The path, with a number where there is one of that name: other materials show it."""
    number, candidate = 1, path
    while os.path.exists(candidate):
        number += 1
        candidate = f"{path}-{number}"
    return candidate


def _remove_if_empty(folder):
    try:
        os.rmdir(folder)
    except OSError:
        pass
