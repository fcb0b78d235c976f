"""Arrays in and out, files of other programs, the board, the documentation."""

from __future__ import annotations

import doctest
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest
import svbrdf

SHAPE = (6, 8)


@pytest.fixture()
def arrays() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(7)
    slopes = rng.uniform(-0.5, 0.5, (*SHAPE, 2))
    normal = np.dstack([slopes, np.ones(SHAPE)])
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return {
        "normal": normal,
        "diffuse": rng.uniform(0, 1, (*SHAPE, 3)),
        "specular": rng.uniform(0, 1, (*SHAPE, 3)),
        "roughness": rng.uniform(0.1, 1, SHAPE),
    }


def test_maps_come_back_as_they_went_in(
    arrays: dict[str, np.ndarray], tmp_path: pathlib.Path
) -> None:
    # In any memory order.
    given = {name: np.asfortranarray(values) for name, values in arrays.items()}
    maps = svbrdf.Maps.from_arrays(**given, sample_mm=(80, 60))
    maps.save(tmp_path)
    for shown in (maps, svbrdf.Maps.load(tmp_path)):
        assert shown.size == SHAPE and shown.sample_mm == (80, 60)
        for name, values in arrays.items():
            found = getattr(shown, name)
            assert found.dtype == np.float32
            # Single precision, and a division for normals.
            assert np.allclose(found, values, atol=1e-6), name
    copy = maps.roughness
    copy[:] = 0
    assert maps.roughness.min() > 0


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("normal", lambda a: a[..., :2]),
        ("normal", lambda a: -a),
        ("diffuse", lambda a: a[:-1]),
        ("diffuse", lambda a: a * np.nan),
        ("specular", lambda a: a + 1),
        ("roughness", lambda a: a[..., None]),
        ("roughness", lambda a: a[:0]),
        ("roughness", lambda a: "text"),
    ],
)
def test_wrong_arrays_are_named(arrays: dict[str, np.ndarray], name: str, change: object) -> None:
    arrays[name] = change(arrays[name])  # type: ignore[operator]
    with pytest.raises(svbrdf.ArgumentError, match=f"^{name}"):
        svbrdf.Maps.from_arrays(**arrays, sample_mm=(80, 60))


@pytest.fixture()
def brushed() -> np.ndarray:
    angle = np.linspace(-1, 1, SHAPE[0] * SHAPE[1]).reshape(SHAPE)
    return np.dstack([np.cos(angle), np.sin(angle), np.full(SHAPE, 0.4)])


def test_optional_lobes_come_back_or_are_none(
    arrays: dict[str, np.ndarray], brushed: np.ndarray, tmp_path: pathlib.Path
) -> None:
    plain = svbrdf.Maps.from_arrays(**arrays, sample_mm=(80, 60))
    assert plain.anisotropy is None and plain.coat is None and plain.sheen is None
    coat = np.dstack([np.full(SHAPE, 0.5), np.full(SHAPE, 0.1)])
    sheen = np.dstack([np.full(SHAPE, v) for v in (0.3, 0.2, 0.0, 0.6)])
    # Ratios of alpha up to 20 are kept.
    arrays["roughness"] = np.maximum(arrays["roughness"], 0.2)
    all_lobes = {"anisotropy": brushed, "coat": coat, "sheen": sheen}
    for given in ({"anisotropy": brushed}, {"coat": coat}, {"sheen": sheen}, all_lobes):
        maps = svbrdf.Maps.from_arrays(**arrays, **given, sample_mm=(80, 60))
        folder = tmp_path / "-".join(given)
        maps.save(folder)
        for shown in (maps, svbrdf.Maps.load(folder)):
            assert np.allclose(shown.roughness, arrays["roughness"], atol=1e-5)
            for name in all_lobes:
                found = getattr(shown, name)
                assert (found is None) == (name not in given)
                if found is not None:
                    assert found.dtype == np.float32
                    assert np.allclose(found, given[name], atol=1e-4), name
    # A lobe that is nowhere there is not shown.
    nothing = svbrdf.Maps.from_arrays(
        **arrays,
        anisotropy=brushed * (1, 1, 0),
        coat=coat * (0, 1),
        sheen=sheen * (0, 0, 0, 1),
        sample_mm=(80, 60),
    )
    assert nothing.anisotropy is None and nothing.coat is None and nothing.sheen is None


def test_highlights_are_longer_along_the_larger_alpha() -> None:
    flat = np.zeros((1, 1, 3)) + (0, 0, 1)
    metal = np.ones((1, 1, 3))
    turned = np.zeros((1, 1, 3)) + (0.6, 0.8, 0.6)
    maps = svbrdf.Maps.from_arrays(
        flat, metal * 0, metal, np.full((1, 1), 0.25), sample_mm=(1, 1), anisotropy=turned
    )
    shown = [
        maps.render(camera_mm=(0, 0, 100), light_mm=(x, y, 100)).mean()
        for x, y in ((18, 24), (-18, -24), (-24, 18), (24, -18))
    ]
    along, across = shown[:2], shown[2:]
    assert np.allclose(along, along[0], rtol=1e-4) and np.allclose(across, across[0], rtol=1e-4)
    assert along[0] > 3 * across[0]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("anisotropy", lambda a: a[..., :2]),
        ("anisotropy", lambda a: a * (1, 1, -1)),
        ("anisotropy", lambda a: a * 2),
        ("coat", lambda a: a),
        ("coat", lambda a: a[:-1, :, :2]),
        ("coat", lambda a: a[..., :2] - 2),
        ("sheen", lambda a: a),
        ("sheen", lambda a: np.dstack([a, a[..., :1] + 2])),
    ],
)
def test_wrong_lobes_are_named(
    arrays: dict[str, np.ndarray], brushed: np.ndarray, name: str, change: object
) -> None:
    lobe = {name: change(brushed)}  # type: ignore[operator]
    with pytest.raises(svbrdf.ArgumentError, match=f"^{name}"):
        svbrdf.Maps.from_arrays(**arrays, **lobe, sample_mm=(80, 60))


def test_photographs_are_read_as_their_types_say() -> None:
    rng = np.random.default_rng(3)
    eight = rng.integers(0, 256, (5, 4, 3), np.uint8)
    sixteen = eight.astype(np.uint16) * 257
    stored = eight / 255.0
    curve = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    for photo in (svbrdf.Photo(eight), svbrdf.Photo(sixteen, "srgb")):
        assert np.allclose(photo.linear(), curve, atol=1e-5)
    for pixels in (stored, stored.astype(np.float32), stored[::-1][::-1]):
        assert np.allclose(svbrdf.Photo(pixels).linear(), stored, atol=1e-7)
    assert np.allclose(svbrdf.Photo(eight, "linear").linear(), stored, atol=1e-7)
    turned = svbrdf.Photo(eight, "linear").turned(90).linear()
    assert np.allclose(turned, np.rot90(stored, -1), atol=1e-7)
    half = svbrdf.Photo(stored * 0.5)
    assert np.allclose(svbrdf.Photo(stored).without_ambient(half).linear(), stored / 2, atol=1e-6)


@pytest.mark.parametrize(
    ("pixels", "options"),
    [
        (np.zeros((5, 4), np.uint8), {}),
        (np.zeros((5, 4, 4), np.uint8), {}),
        (np.zeros((0, 4, 3), np.uint8), {}),
        (np.zeros((5, 4, 3), np.int64), {}),
        (np.zeros((5, 4, 3), np.float32), {"encoding": "srgb"}),
        (np.zeros((5, 4, 3), np.uint8), {"encoding": "log"}),
        (np.zeros((5, 4, 3), np.uint8), {"saturation": 1.0}),
        (np.zeros((5, 4, 3), np.uint8), {"exposure": 0}),
        ([[1, 2, 3]], {}),
        ("text", {}),
    ],
)
def test_wrong_photographs_are_refused(pixels: object, options: dict[str, object]) -> None:
    with pytest.raises(svbrdf.ArgumentError):
        svbrdf.Photo(pixels, **options)  # type: ignore[arg-type]


def test_values_that_are_no_numbers_are_a_rejection() -> None:
    session = svbrdf.Session(sample_mm=(100, 100))
    rejected = session.add_photo(svbrdf.Photo(np.full((40, 60, 3), np.nan)))
    assert isinstance(rejected, svbrdf.Rejected) and rejected.code == "not_finite"


def test_renderings_are_the_command_lines(
    command: str, arrays: dict[str, np.ndarray], tmp_path: pathlib.Path
) -> None:
    maps = svbrdf.Maps.from_arrays(**arrays, sample_mm=(100, 75))
    maps.save(tmp_path)
    out = tmp_path / "lit.png"
    subprocess.run(
        [command, "render", str(tmp_path), "--camera-mm=20,0,300", "--light-mm=80,0,200"]
        + ["--out", str(out)],
        check=True,
    )
    theirs = svbrdf.Photo.read(out, "linear").linear()
    ours = maps.render(camera_mm=(20, 0, 300), light_mm=(80, 0, 200))
    # 16 bits of a picture that is clipped at 1.
    assert np.abs(np.clip(ours, 0, 1) - theirs).max() < 2e-5
    with pytest.raises(svbrdf.ArgumentError, match="light_mm"):
        maps.render(camera_mm=(0, 0, 1), light_mm=(0, 0, -1))


def test_exports_are_written_whole_or_not_at_all(
    arrays: dict[str, np.ndarray], tmp_path: pathlib.Path
) -> None:
    maps = svbrdf.Maps.from_arrays(**arrays, sample_mm=(80, 60))
    names = maps.export(tmp_path / "out", ["glb", "blender"])
    assert {"material.glb", "blender/material.py"} <= set(names)
    files = maps.package(["glb"])
    assert files["material.glb"] == (tmp_path / "out" / "material.glb").read_bytes()
    with pytest.raises(svbrdf.ArgumentError, match="formats"):
        maps.export(tmp_path, ["blend"])  # type: ignore[list-item]
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    for write in (lambda: maps.export(blocked, ["glb"]), lambda: maps.save(blocked)):
        with pytest.raises(svbrdf.FileError, match="file"):
            write()
    maps.save_preview(tmp_path / "preview.png")
    assert svbrdf.Photo.read(tmp_path / "preview.png").width > 0


@pytest.mark.skipif(os.name != "posix", reason="permissions are POSIX's")
def test_folders_without_permission_are_told(
    arrays: dict[str, np.ndarray], tmp_path: pathlib.Path
) -> None:
    maps = svbrdf.Maps.from_arrays(**arrays, sample_mm=(80, 60))
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    is_root = os.geteuid() == 0
    if is_root:
        # Root may write anywhere.
        os.seteuid(65534)
    try:
        for write in (
            lambda: maps.save(locked / "maps"),
            lambda: maps.export(locked / "material", ["glb"]),
            lambda: maps.save_preview(locked / "preview.png"),
            lambda: svbrdf.Board().write(locked / "board.pdf"),
        ):
            with pytest.raises(svbrdf.FileError, match="[Pp]ermission denied"):
                write()
    finally:
        if is_root:
            os.seteuid(0)
    assert os.listdir(locked) == []


def test_the_board_is_the_command_lines(command: str, tmp_path: pathlib.Path) -> None:
    for ending in ("pdf", "svg"):
        ours, theirs = tmp_path / f"ours.{ending}", tmp_path / f"theirs.{ending}"
        svbrdf.Board().write(ours)
        subprocess.run([command, "board", "--out", str(theirs)], check=True, capture_output=True)
        assert ours.read_bytes() == theirs.read_bytes()
    assert svbrdf.Board().hole_mm == (115, 126.5)
    charuco = svbrdf.Board("charuco-ring", rows=17, cols=16, square_mm=11.5)
    assert charuco.kind == "charuco-ring" and charuco != svbrdf.Board()
    assert charuco.encode("png")[1:4] == b"PNG"
    for wrong in ({"rows": 2}, {"square_mm": -1}, {"kind": "circles"}, {"top_left": "gray"}):
        with pytest.raises(svbrdf.ArgumentError):
            svbrdf.Board(**wrong)  # type: ignore[arg-type]
    with pytest.raises(svbrdf.ArgumentError, match="format"):
        svbrdf.Board().write(tmp_path / "board.txt")


def test_examples_of_the_documentation_run() -> None:
    tested = [doctest.testmod(module) for module in (svbrdf, sys.modules["svbrdf.fitting"])]
    # doctest does not look at static methods of native classes.
    runner = doctest.DocTestRunner()
    static = svbrdf.Maps.from_arrays
    for test in doctest.DocTestFinder().find(static, "from_arrays", globs=dict(vars(svbrdf))):
        tested.append(runner.run(test))
    assert all(t.failed == 0 for t in tested)
    assert sum(t.attempted for t in tested) >= 15, tested
    readme = pathlib.Path(__file__).parents[1] / "README.md"
    assert doctest.testfile(str(readme), module_relative=False).failed == 0


def test_everything_public_is_described_and_typed() -> None:
    undescribed = [n for n in svbrdf.__all__ if not getattr(getattr(svbrdf, n), "__doc__", None)]
    assert undescribed == []
    folder = pathlib.Path(svbrdf.__file__).parent
    assert (folder / "py.typed").exists()
    stubs = (folder / "_native.pyi").read_text()
    native = sys.modules["svbrdf._native"]
    for name in dir(native):
        kind = getattr(native, name)
        if not isinstance(kind, type):
            continue
        body = stubs.split(f"class {name}:")[1].split("\n@final")[0]
        for member in vars(kind):
            if not member.startswith("__"):
                assert f"def {member}(" in body, f"{name}.{member} is not in _native.pyi"
