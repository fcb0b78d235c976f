"""Sessions: outcomes, reports, saving, cancelling."""

from __future__ import annotations

import os
import pathlib
import signal
import threading

import numpy as np
import pytest
import svbrdf
from conftest import STEPS

Rows = list[svbrdf.Photo]


@pytest.fixture(scope="module")
def described(capture: pathlib.Path) -> svbrdf.Capture:
    return svbrdf.Capture.load(capture)


@pytest.fixture(scope="module")
def photos(described: svbrdf.Capture) -> Rows:
    return [file.read() for file in described.photos[:2]]


def test_a_saved_session_goes_on_to_the_same_maps(described: svbrdf.Capture, photos: Rows) -> None:
    with svbrdf.Session.of_capture(described) as session:
        session.set_budget(steps=STEPS)
        session.add_photo(photos[0])
        session.wait()
        saved = session.save()
        session.add_photo(photos[1])
        session.wait()
        expected = session.snapshot()
    with svbrdf.Session.restore(saved, threads=1) as restored:
        assert restored.progress.photos == 1
        restored.add_photo(photos[1])
        restored.wait()
        # Off by a small part of the maps' deviations.
        off = restored.snapshot().normal - expected.normal
        assert np.sqrt(np.mean(off**2)) < 0.01
        restored.remove_photo(1)
        assert restored.progress.photos == 1
    for damaged in [b"", b"something else", saved[: len(saved) // 2]]:
        with pytest.raises(svbrdf.StateError):
            svbrdf.Session.restore(damaged)


def test_what_is_known_is_told(described: svbrdf.Capture, photos: Rows) -> None:
    with svbrdf.Session.of_capture(described) as session:
        assert session.next_view() is None
        with pytest.raises(svbrdf.NoMapsError):
            session.snapshot()
        probe = session.probe(photos[0])
        assert probe.rejection is None and probe.corners > 0.5 * probe.corners_expected
        assert probe.sample_px is not None and len(probe.sample_px) == 4
        session.set_budget(steps=STEPS)
        outcome = session.add_photo(photos[0])
        assert isinstance(outcome, svbrdf.Accepted) and outcome and outcome.index == 0
        # The probe looked at a smaller picture.
        assert outcome.camera_mm is not None and probe.distance_mm is not None
        assert np.linalg.norm(outcome.camera_mm) == pytest.approx(probe.distance_mm, rel=0.02)
        again = session.add_photo(photos[0])
        assert isinstance(again, svbrdf.Accepted)
        assert [hint.code for hint in again.hints] == ["nothing_new"]
        first, second = session.hints()
        assert "nothing_new" not in [hint.code for hint in first]
        assert [h.message for h in second if h.code == "nothing_new"] == [again.hints[0].message]
        rejected = session.add_photo(svbrdf.Photo(np.zeros((40, 60, 3), np.uint8)))
        assert isinstance(rejected, svbrdf.Rejected) and not rejected
        assert rejected.code == "wrong_size" and "60x40" in rejected.message
        view = session.next_view()
        assert view is not None and 10 <= view.tilt_deg <= 50
        camera = session.camera
        assert camera is not None and camera.width == photos[0].width


def test_a_cancelled_session_keeps_its_maps(described: svbrdf.Capture, photos: Rows) -> None:
    session = svbrdf.Session.of_capture(described)
    session.pause()
    session.add_photo(photos[0])
    assert not session.wait(0)
    session.cancel()
    assert session.snapshot().size == (256, 256)
    for call in (lambda: session.add_photo(photos[1]), session.wait, session.save):
        with pytest.raises(svbrdf.CancelledError):
            call()


def test_python_runs_while_a_session_waits_and_signals_end_the_waiting(
    described: svbrdf.Capture, photos: Rows
) -> None:
    # Shells start background processes with interrupts ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with svbrdf.Session.of_capture(described) as session:
        session.set_budget(steps=STEPS)
        session.pause()
        session.add_photo(photos[0])
        # Only a signal ends this: the fit is held.
        interrupt = threading.Thread(target=lambda: os.kill(os.getpid(), signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            interrupt.start()
            session.wait()
        interrupt.join()
        # Only another thread of Python ends this.
        resume = threading.Timer(0.05, session.resume)
        resume.start()
        assert session.wait(600)
        resume.join()


def test_announced_photographs_are_one_piece_of_work(
    described: svbrdf.Capture, photos: Rows
) -> None:
    with svbrdf.Session.of_capture(described) as session:
        session.set_budget(steps=STEPS)
        for photo in photos:
            session.pause()
            session.add_photo(photo)
            assert session.progress.fraction == 0
            session.resume()
            session.wait()
            assert session.progress.fraction == 1
        session.announce(3)
        assert session.progress.fraction == 0
        session.add_photo(photos[0])
        session.wait()
        assert session.progress.fraction == pytest.approx(1 / 3)
        session.add_photo(svbrdf.Photo(np.zeros((40, 60, 3), np.uint8)))
        assert session.progress.fraction == 0.5
        session.announce(0)
        assert session.progress.fraction == 1
        with pytest.raises(OverflowError):
            session.announce(-1)


def test_rectified_photographs_are_explained() -> None:
    rng = np.random.default_rng(1)
    flat = np.zeros((64, 64, 3))
    flat[..., 2] = 1
    diffuse = rng.uniform(0.1, 0.6, (64, 64, 3))
    truth = svbrdf.Maps.from_arrays(
        flat, diffuse, flat * 0 + 0.04, np.full((64, 64), 0.5), sample_mm=(100, 100)
    )
    places = [(0.0, 0.0, 200.0), (60.0, 0.0, 200.0), (-60.0, 30.0, 200.0)]
    # 64 texels a side become 256.
    pictures = [
        truth.render(camera_mm=p, light_mm=p).repeat(4, axis=0).repeat(4, axis=1) for p in places
    ]
    with svbrdf.Session.rectified(sample_mm=(100, 100), falloff="none", threads=1) as session:
        for place, picture in zip(places, pictures):
            assert session.add_rectified_photo(svbrdf.Photo(picture), camera_mm=place, light_mm=place)
        session.wait()
        maps = session.snapshot()
    for place, picture in zip(places, pictures):
        shown = maps.render(camera_mm=place, light_mm=place)
        # Diffuse and specular parts trade against each other. Their sum is determined, up to the gain of each
        # rectified photograph.
        gain = picture.sum() / shown.sum()
        error = np.abs(gain * shown - picture).mean() / picture.mean()
        assert 0.5 < gain < 2 and error < 0.1, (gain, error)


def test_limits_are_kept(described: svbrdf.Capture) -> None:
    with pytest.raises(svbrdf.MemoryLimitError) as raised:
        svbrdf.Session.of_capture(described, resolution=2048, memory_limit_mib=10)
    assert isinstance(raised.value, MemoryError)
    for wrong in [(0, 100), (float("nan"), 100)]:
        with pytest.raises(svbrdf.ArgumentError, match="sample_mm"):
            svbrdf.Session(sample_mm=wrong)
    session = svbrdf.Session(sample_mm=(100, 100))
    for seconds in (-1, float("nan")):
        with pytest.raises(svbrdf.ArgumentError, match="timeout"):
            session.wait(seconds)
