"""Fits: the same as the command line's, told as they go, ended in order."""

from __future__ import annotations

import os
import pathlib
import signal
import struct
import subprocess
import threading

import numpy as np
import pytest
import svbrdf
from conftest import FRAMES, STEPS

FILES = ["maps.exr", "normal.png", "diffuse.png", "specular.png", "roughness.png"]


def test_maps_are_the_command_lines_to_the_byte(
    capture: pathlib.Path, told_by_the_command_line: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    # More threads than there: results do not depend on their number.
    maps = svbrdf.fit(capture, photos=FRAMES, steps=STEPS, threads=2)
    maps.save(tmp_path)
    for name in FILES:
        ours, theirs = (d.joinpath(name).read_bytes() for d in (tmp_path, told_by_the_command_line))
        assert ours == theirs, name
    assert [p.accepted for p in maps.photos] == [True] * FRAMES
    assert all(p.reprojection_rms_px < 1 for p in maps.photos)
    read = svbrdf.Maps.load(told_by_the_command_line)
    assert read.sample_mm == maps.sample_mm and read.size == maps.size == (256, 256)
    for name in ["diffuse", "specular", "roughness"]:
        assert np.array_equal(getattr(read, name), getattr(maps, name)), name
    # Normals are stored, slopes are fitted: rounding of floats lies between.
    assert np.abs(read.normal - maps.normal).max() < 1e-6
    assert maps.deviations is not None and read.deviations is None
    assert maps.deviations["roughness"].shape == (256, 256)


def test_arrays_and_files_give_what_the_capture_gives(capture: pathlib.Path) -> None:
    described = svbrdf.Capture.load(capture)
    files = described.photos[:FRAMES]
    expected = svbrdf.fit(described, photos=FRAMES, steps=STEPS)
    photos = [file.read() for file in files]
    with svbrdf.Session.of_capture(described) as session:
        session.set_budget(steps=STEPS)
        for file, photo in zip(files, photos):
            # The values as they are, and as linear floats that say which of them are clipped.
            assert file.exposure == photo.exposure
            assert session.add_photo(photo)
            session.wait()
        found = session.snapshot()
    assert np.array_equal(found.roughness, expected.roughness)
    assert np.array_equal(found.normal, expected.normal)


def test_progress_is_told_in_order(capture: pathlib.Path) -> None:
    told: list[svbrdf.FitProgress] = []
    svbrdf.fit(capture, photos=FRAMES, steps=STEPS, on_progress=told.append)
    shares = [t.fraction for t in told]
    assert shares == sorted(shares) and shares[0] == 0 and shares[-1] == 1
    assert {t.photo for t in told} == {1, 2} and {t.photos for t in told} == {2}
    assert len(told[-1].so_far) == FRAMES


def test_what_on_progress_raises_ends_the_fit(capture: pathlib.Path) -> None:
    def stop(progress: svbrdf.FitProgress) -> None:
        if progress.fraction > 0:
            raise svbrdf.CancelledError("enough")

    with pytest.raises(svbrdf.CancelledError, match="enough"):
        svbrdf.fit(capture, on_progress=stop)


def test_ctrl_c_ends_the_fit(capture: pathlib.Path) -> None:
    # Shells start background processes with interrupts ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    beginning, asked = threading.Event(), threading.Event()

    def interrupt() -> None:
        beginning.wait()
        os.kill(os.getpid(), signal.SIGINT)
        asked.set()

    def begun(progress: svbrdf.FitProgress) -> None:
        if progress.fraction > 0:
            beginning.set()
            # A fast fit would be through before.
            asked.wait()

    thread = threading.Thread(target=interrupt, daemon=True)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        svbrdf.fit(capture, on_progress=begun)
    thread.join()


def test_photographs_without_a_description_are_the_command_lines(
    command: str, capture: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    # Their own board, which only the command's name of it tells.
    board = svbrdf.Board(
        rows=19, cols=14, square_mm=10, hole_squares=(3, 2, 16, 12), patches=True
    )
    photos = sorted((capture / "frames").glob("0[0-2].jpg"))
    (tmp_path / "photos").mkdir()
    for photo in photos:
        (tmp_path / "photos" / photo.name).write_bytes(photo.read_bytes())
    (tmp_path / "photos" / "notes.txt").write_text("no picture")
    subprocess.run(
        [command, "fit", str(tmp_path / "photos"), "--out", str(tmp_path / "cli"), "--quiet"]
        + ["--no-report", "--steps", str(STEPS), "--sample-mm", "88"]
        + ["--board", "ring:19x14:10:3,2,16,12"],
        check=True,
    )
    for source in (tmp_path / "photos", photos):
        maps = svbrdf.fit(source, board=board, sample_mm=(88, 88), steps=STEPS)
        assert [p.accepted for p in maps.photos] == [True] * 3
        maps.save(tmp_path / "ours")
        for name in FILES:
            ours, theirs = (tmp_path.joinpath(d, name).read_bytes() for d in ("ours", "cli"))
            assert ours == theirs, name


def test_photographs_that_all_fail_raise_with_their_reasons(tmp_path: pathlib.Path) -> None:
    gray = svbrdf.Photo(np.full((480, 640, 3), 128, np.uint8))
    with pytest.raises(svbrdf.RejectedError) as raised:
        svbrdf.fit([gray])
    assert [p.code for p in raised.value.photos] == ["board_not_found"]
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"\xff\xd8\xff\xe0 no picture")
    with pytest.raises(svbrdf.RejectedError, match="broken.jpg") as raised:
        svbrdf.fit([broken])
    assert [p.code for p in raised.value.photos] == ["unreadable"]
    # As NEF and ARW: a TIFF whose last bytes, the directory, tell of a colour filter array.
    raw, entry = tmp_path / "raw.nef", struct.pack("<HHIHH", 262, 3, 1, 32803, 0)
    directory = struct.pack("<H", 1) + entry + bytes(4)
    raw.write_bytes(b"II*\0" + struct.pack("<I", 8 + (1 << 20)) + bytes(1 << 20) + directory)
    with pytest.raises(svbrdf.RejectedError, match="raw file of a camera maker"):
        svbrdf.fit([raw])
    for wrong in ([], [gray, broken]):
        with pytest.raises(svbrdf.ArgumentError, match="source"):
            svbrdf.fit(wrong)
    for missing in (tmp_path / "nowhere", [tmp_path / "nowhere.jpg"]):
        with pytest.raises(svbrdf.FileError, match="nowhere"):
            svbrdf.fit(missing)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"resolution": 300}, "resolution"),
        ({"method": "magic"}, "method"),
        ({"photos": 0}, "photos"),
        ({"sample_mm": (100, 100)}, "sample_mm: the capture states"),
    ],
)
def test_options_are_checked(
    capture: pathlib.Path, options: dict[str, object], message: str
) -> None:
    with pytest.raises(svbrdf.ArgumentError, match=message):
        svbrdf.fit(capture, **options)  # type: ignore[arg-type]


def test_faults_of_a_description_name_the_field(tmp_path: pathlib.Path) -> None:
    (tmp_path / "capture.json").write_text('{"format": "svbrdf-capture/2"}')
    with pytest.raises(svbrdf.FieldError, match="format"):
        svbrdf.fit(tmp_path)
    (tmp_path / "capture.json").unlink()
    with pytest.raises(svbrdf.FileError) as raised:
        svbrdf.fit(tmp_path)
    assert isinstance(raised.value, OSError) and isinstance(raised.value, svbrdf.Error)
