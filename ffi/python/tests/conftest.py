"""Fixtures: the capture of the repository, and the command line that was built beside the wheel."""

from __future__ import annotations

import os
import pathlib
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
CAPTURE = ROOT / "examples" / "captures" / "tile"
#: Photographs and steps: enough to tell maps apart, and quick.
FRAMES, STEPS = 2, 8


@pytest.fixture(scope="session")
def capture() -> pathlib.Path:
    return CAPTURE


@pytest.fixture(scope="session")
def command() -> str:
    """The command line: ``SVBRDF_CLI``, or the build of cargo."""
    path = os.environ.get("SVBRDF_CLI", str(ROOT / "target" / "release" / "svbrdf"))
    if not os.path.exists(path):
        pytest.fail(f"{path} is missing: cargo build --release -p svbrdf-cli, or set SVBRDF_CLI")
    return path


@pytest.fixture(scope="session")
def told_by_the_command_line(
    command: str, capture: pathlib.Path, tmp_path_factory: pytest.TempPathFactory
) -> pathlib.Path:
    """A folder with the command line's maps of the first photographs."""
    out = tmp_path_factory.mktemp("cli") / "maps"
    subprocess.run(
        [command, "fit", str(capture), "--out", str(out), "--quiet", "--no-report"]
        + ["--frames", str(FRAMES), "--steps", str(STEPS), "--threads", "1"],
        check=True,
    )
    return out
