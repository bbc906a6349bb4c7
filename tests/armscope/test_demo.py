"""The demo, with short motions: what it promises to leave behind is there and is what it says."""

from __future__ import annotations

import html
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from daq.recording import open_recording


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_demo(root: Path, tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "armscope", "demo", "--out", "demo", "--json"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(root)},
        text=True,
        capture_output=True,
        timeout=300,
    )
    assert ended.returncode == 0, ended.stderr
    assert Path(ended.stderr.splitlines()[-1]).stat().st_size > 10_000
    shown = re.findall(r"^    (Explained:.*(?:\n    .+)*)", (root / "README.md").read_text(), re.M)
    assert [" ".join(block.split()) in [*map(str.strip, ended.stderr.splitlines())] for block in shown] == [True]
    answer = json.loads(ended.stdout)
    assert (tmp_path / "demo/currents.png").read_bytes().startswith(b"\x89PNG")
    diagnosis = json.loads((tmp_path / "demo/diagnosis/diagnosis.json").read_text())
    assert answer["diagnosis"] == diagnosis and answer["identification"]["parameters"]
    named = {(cause["effect"], cause["joint"]) for cause in diagnosis["causes"]}
    assert ("load_friction", 2) in named and {joint for _, joint in named} == {1, 2, 3}
    page = html.unescape((tmp_path / "demo/diagnosis/report.html").read_text())
    assert "<code>tau = mu |tau_load| sign(q')</code>" in page  # of terms that were not found, no symbol
    warnings = [one for one in diagnosis["warnings"] if "looks like an inertia" in one]
    assert all(float(re.findall(r"by less than ([0-9.]+) times the noise", one)[0]) < 3.0 for one in warnings)
    runs = [open_recording(tmp_path / f"demo/{name}.mcap") for name in ("excitation", "iso_cube")]
    (received,) = re.findall(r"received (\d+) rows in 2 runs and missed 0", ended.stderr)
    assert int(received) == sum(map(len, runs))
    assert all(recording.ledger.lost == 0 for recording in runs)
    assert (tmp_path / "demo/identified/report.html").stat().st_size > 1000


def test_a_recording_that_fails_ends_the_demo(root: Path, tmp_path: Path) -> None:
    """Its daemon and its subscriber end with it."""
    ended = subprocess.run(
        [sys.executable, "-m", "armscope", "demo", "--out", "demo", "--fit", "no_such_experiment"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(root)},
        text=True,
        capture_output=True,
        timeout=100,
    )
    assert ended.returncode == 3 and "no_such_experiment" in ended.stderr.splitlines()[-1]
