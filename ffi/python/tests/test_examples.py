"""Each example runs, on the capture of the repository."""

from __future__ import annotations

import importlib.util
import pathlib
import types

from conftest import ROOT


def example(name: str) -> types.ModuleType:
    """The module of an example."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / "python" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_live_loop_uses_the_photographs(capture: pathlib.Path) -> None:
    assert example("live_loop").run(capture, 2) == 2


def test_photographs_are_added_until_the_roughness_is_known(capture: pathlib.Path) -> None:
    known = example("uncertainty").run(capture, 1.0, 3)
    assert len(known) == 1 and 0.01 < known[0] < 0.5


def test_rectified_photographs_determine_the_albedo() -> None:
    # A uniform albedo would be off by 0.125.
    assert example("rectified").run() < 0.05


def test_maps_become_files_in_memory(capture: pathlib.Path) -> None:
    files = example("export_in_memory").run(capture / "truth")
    assert files["material.glb"][:4] == b"glTF" and "unreal/orm.png" in files
