"""The notebook of examples/python: it runs from its first cell to its last, and shows what it says."""

from __future__ import annotations

import os
import pathlib
import re
import subprocess
import sys

import pytest

from conftest import ROOT


def test_the_notebook_runs_and_its_errors_fall(tmp_path: pathlib.Path) -> None:
    pytest.importorskip("matplotlib")
    done = subprocess.run(
        [sys.executable, "examples/python/notebook.py"],
        cwd=ROOT,
        env={**os.environ, "PICTURES": str(tmp_path), "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    errors = [float(error) for error in re.findall(r"off by ([\d.]+)", done.stdout)]
    assert len(errors) == 5 and errors[4] < 0.8 * errors[0], done.stdout
    pictures = {file.name for file in tmp_path.iterdir() if file.stat().st_size > 5000}
    assert pictures == {f"{name}.jpg" for name in ("photographs", "maps", "deviations", "light")}
