"""From photographs to maps in one call."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from ._native import (
    Board,
    Camera,
    Capture,
    Hint,
    Maps,
    Photo,
    PhotoFile,
    Rejected,
    Session,
    _choose,
    _pictures,
)
from .errors import ArgumentError, FieldError, FileError, RejectedError

#: Seconds between two reports of progress.
_LOOK = 0.1


@dataclass(frozen=True)
class PhotoReport:
    """The report of a photograph."""

    #: The file, or the number among the photographs given, from 0.
    source: str | int
    #: Whether it is in the fit.
    accepted: bool
    #: Why not, as a name for programs such as ``board_not_found``; of files also ``unreadable``, and ``left_out`` for those of
    #: another camera. Empty where accepted.
    code: str = ""
    #: Why not, as a sentence. Empty where accepted.
    message: str = ""
    #: Hints about it.
    hints: tuple[Hint, ...] = ()
    #: Reprojection error of the board, px.
    reprojection_rms_px: float | None = None


@dataclass(frozen=True)
class FitProgress:
    """How far a fit has come."""

    #: The photograph being worked on, from 1.
    photo: int
    #: Photographs there are.
    photos: int
    #: Fraction of all work that is done, 0 to 1; it never falls.
    fraction: float
    #: Mean difference of the logarithms of photographs and renderings; 0 before the first fit.
    loss: float
    #: Seconds left on this photograph, if known.
    seconds_left: float | None
    #: Reports of the photographs so far.
    so_far: tuple[PhotoReport, ...] = ()


def fit(
    source: str | os.PathLike[str] | Capture | Iterable[Photo | str | os.PathLike[str]],
    *,
    sample_mm: tuple[float, float] | None = None,
    board: Board | None = None,
    camera: Camera | None = None,
    flash_offset_mm: tuple[float, float, float] | None = None,
    resolution: int = 256,
    method: Literal["deep", "classic"] = "deep",
    refine: bool = True,
    photos: int | None = None,
    steps: int | None = None,
    threads: int = 0,
    on_progress: Callable[[FitProgress], object] | None = None,
) -> Maps:
    """Fits maps to photographs, as ``svbrdf fit`` does, and says how far they may be off.

    ``source`` is a folder with ``capture.json``, a ``Capture``, or photographs of ``board``: a folder of them, image files
    (JPEG, PNG, TIFF, OpenEXR, DNG) or ``Photo`` objects. Of files, exposure, order and camera are read from their metadata;
    those of another camera are left out. A capture says itself what sample, board and flash are; for photographs
    ``sample_mm`` is by default a square that the board's hole holds with 5 mm to spare, and ``camera`` and
    ``flash_offset_mm`` are estimated unless given. ``photos`` uses the first ones only, ``steps`` limits the optimisers' steps on each photograph.

    ``on_progress`` is called several times a second. Ctrl-C, or an exception in it, ends the fit.

    Raises ``RejectedError`` when no photograph can be used. Others are left out; ``Maps.photos`` says why.

    >>> fit("no such folder")
    Traceback (most recent call last):
        ...
    svbrdf.errors.FileError: no such folder: there is no such folder
    """
    shown = _capture(source, camera)
    if isinstance(shown, Capture):
        stated = {"sample_mm": sample_mm, "board": board, "flash_offset_mm": flash_offset_mm}
        for name, given in stated.items():
            if given is not None:
                raise ArgumentError(f"{name}: the capture states this itself")
        session = Session.of_capture(
            shown, resolution=resolution, method=method, refine=refine, threads=threads
        )
        sources: list[PhotoFile | Photo] = list(shown.photos)
        left_out: list[PhotoReport] = []
    else:
        sources, left_out = shown
        session = Session(
            sample_mm=sample_mm or (board or Board()).usual_sample_mm,
            board=board,
            camera=camera,
            flash_offset_mm=flash_offset_mm,
            resolution=resolution,
            method=method,
            refine=refine,
            threads=threads,
        )
    if photos is not None and photos < 1:
        raise ArgumentError(f"photos: {photos} given; at least 1 expected")
    with session:
        session.set_budget(steps=steps)
        told = (*_run(session, sources[:photos], on_progress), *left_out)
        if not any(photo.accepted for photo in told):
            reasons = "\n".join(f"{p.source}: {p.message}" for p in told)
            raise RejectedError(f"every photograph was rejected:\n{reasons}", told)
        return session.snapshot_with_uncertainty()._with_photos(told)


def _capture(
    source: str | os.PathLike[str] | Capture | Iterable[Photo | str | os.PathLike[str]],
    camera: Camera | None,
) -> Capture | tuple[list[PhotoFile | Photo], list[PhotoReport]]:
    """A capture, or photographs without a description and those left out."""
    if isinstance(source, Capture):
        if camera is not None:
            raise ArgumentError("camera: give it to Capture.load")
        return source
    if isinstance(source, (str, os.PathLike)):
        folder = os.fspath(source)
        if not os.path.isdir(folder):
            raise FileError(f"{folder}: there is no such folder")
        if os.path.isfile(os.path.join(folder, "capture.json")):
            return Capture.load(folder, camera=camera)
        paths = [os.fspath(path) for path in _pictures(folder)]
        if not paths:
            raise FileError(f"{folder}: neither capture.json nor a photograph is there")
        return _of_files(paths)
    items = list(source)
    if not items:
        raise ArgumentError("source: at least one photograph is expected")
    photos = [item for item in items if isinstance(item, Photo)]
    if not photos:
        return _of_files([os.fspath(item) for item in items if not isinstance(item, Photo)])
    if len(photos) < len(items):
        raise ArgumentError("source: files or Photo objects are expected, not both")
    return list(photos), []


def _of_files(paths: list[str]) -> tuple[list[PhotoFile | Photo], list[PhotoReport]]:
    """Photographs of one camera, in order, and those left out."""
    for path in paths:
        if not os.path.isfile(path):
            raise FileError(f"{path}: there is no such file")
    files, left_out, _ = _choose(list(paths))
    return list(files), [PhotoReport(str(path), False, "left_out", why) for path, why in left_out]


def _run(
    session: Session,
    sources: list[PhotoFile | Photo],
    on_progress: Callable[[FitProgress], object] | None,
) -> Iterator[PhotoReport]:
    """Adds one photograph after the other and waits for the fit of each."""
    told: list[PhotoReport] = []

    def tell(at: int) -> None:
        if on_progress is not None:
            now = session.progress
            whole, left = now.fraction, now.seconds_left
            on_progress(FitProgress(at, len(sources), whole, now.loss, left, tuple(told)))

    for number, source in enumerate(sources):
        # Anew each time: one that cannot be read is not added.
        session.announce(len(sources) - number)
        tell(number + 1)
        told.append(_add(session, number, source))
        if told[-1].accepted:
            while not session.wait(_LOOK):
                tell(number + 1)
        yield told[-1]
    session.announce(0)
    tell(len(sources))


def _add(session: Session, number: int, given: PhotoFile | Photo) -> PhotoReport:
    source: str | int = number
    rectified = None
    remarks: list[Hint] = []
    if isinstance(given, PhotoFile):
        source, rectified = str(given.path), given.rectified
        try:
            photo, remarks = given._read_with_hints()
        except (FileError, FieldError) as fault:
            return PhotoReport(source, False, "unreadable", str(fault))
    else:
        photo = given
    if rectified is None:
        outcome = session.add_photo(photo)
    else:
        outcome = session.add_rectified_photo(photo, camera_mm=rectified[0], light_mm=rectified[1])
    if isinstance(outcome, Rejected):
        return PhotoReport(source, False, outcome.code, outcome.message, tuple(remarks))
    hints, rms = (*outcome.hints, *remarks), outcome.reprojection_rms_px
    return PhotoReport(source, True, hints=hints, reprojection_rms_px=rms)
