"""Held-out poses must be measured anew: copies of fitted rows are refused, poses taken again are said."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from daq.recording import Attachments, write_table
from identification.kinematics.data import Poses, check_new

sys.path.insert(0, str(Path(__file__).parent))
from foreign_arm import DESCRIPTION, ForeignArm


@pytest.fixture(scope="module")
def measured() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q (100, 6) rad; xyz (100, 3) m of two measurements at the same poses."""
    arm, generator = ForeignArm(seed=11), np.random.default_rng(12)
    q = arm.reported(100, generator)
    return q, arm.measured(q, generator), arm.measured(q, generator)


def table(path: Path, q: np.ndarray, xyz: np.ndarray, t: np.ndarray | None = None, form: str = "%.17g") -> str:
    head, rows = [*(f"q{j}" for j in range(1, 7)), "x", "y", "z"], np.column_stack((q, xyz))
    if t is not None:
        head, rows = ["t", *head], np.column_stack((t, rows))
    np.savetxt(path, rows, fmt=form, delimiter=",", header=",".join(head), comments="")
    return str(path)


def calibrate(folder: Path, *arguments: str) -> int:
    (folder / "foreign.toml").write_text(DESCRIPTION)
    common = ["--model", str(folder / "foreign.toml"), "--out", str(folder / "out"), "--geometry-only"]
    return run(["calibrate", *arguments, *common])


@pytest.mark.parametrize(
    ("rows", "form", "share"),
    [
        (np.arange(60), "%.17g", "60 of its 60"),
        (np.arange(30, 60), "%.17g", "30 of its 30"),
        (np.arange(59, 0, -3), "%.8f", "of its 20"),
        (np.r_[40:100], "%.17g", "20 of its 60"),
    ],
    ids=["all", "half", "backwards, every third", "part"],
)
def test_fitted_poses_are_not_held_out(
    rows: np.ndarray, form: str, share: str, measured: tuple, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    q, xyz, _ = measured
    fitted = table(tmp_path / "fitted.csv", q[:60], xyz[:60])
    held = table(tmp_path / "held.csv", q[rows], xyz[rows], form=form)
    assert calibrate(tmp_path, fitted, "--held-out", held) == 2
    captured = capfd.readouterr()
    assert captured.err.count("\n") == 1 and captured.out == ""
    assert captured.err.startswith(f"error: {held}: is both fitted and held out: ")
    assert f"{share} rows are in {fitted}" in captured.err
    assert not (tmp_path / "out").exists()
    assert calibrate(tmp_path, fitted, held) == 2
    line = capfd.readouterr().err
    assert line.startswith(f"error: {held}: is given twice: ") and f"{share} rows" in line


def test_poses_measured_anew_are_taken_with_a_warning(
    measured: tuple, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    q, xyz, again = measured
    files = table(tmp_path / "fitted.csv", q[:60], xyz[:60]), table(tmp_path / "held.csv", q[40:], again[40:])
    assert calibrate(tmp_path, files[0], "--held-out", files[1]) == 0
    said = "held.csv: 20 of 60 held-out poses have the joint angles of fitted ones"
    assert said in capfd.readouterr().err
    assert any(said in line for line in json.loads((tmp_path / "out/kinematics.json").read_text())["warnings"])


def test_coarse_points_may_come_out_the_same(measured: tuple) -> None:
    """Of a tracker that shows 0.1 mm, whose points say nothing where the robot repeats to less."""
    q, xyz, _ = measured
    coarse = np.rint(xyz[:30] * 1e4) / 1e4
    sides = [Poses(Path(f"{name}.csv"), q[rows], coarse[rows], True) for name, rows in
             (("a", slice(0, 20)), ("b", slice(10, 30)))]  # fmt: skip
    (warning,) = check_new(sides[:1], sides[1:])
    assert "10 of 20 held-out poses" in warning


def test_a_recording_and_its_export(measured: tuple, tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    """Rows of a motion, held out as the table that was exported, cut and given other times."""
    t = np.arange(600) / 100.0
    arm, generator = ForeignArm(seed=11), np.random.default_rng(3)
    q = np.sin(t[:, None] * (0.3 + 0.1 * np.arange(6)))
    xyz, again = arm.measured(q, generator), arm.measured(q, generator)
    write_table(tmp_path / "run.mcap", t, {"q": q, "i": np.cos(q), "xyz": xyz}, Attachments())
    held = table(tmp_path / "held.csv", q[301:], xyz[301:], t[301:] - t[301])
    assert calibrate(tmp_path, str(tmp_path / "run.mcap"), "--held-out", held) == 2
    assert "held.csv: is both fitted and held out: 299 of its 299 rows" in capfd.readouterr().err
    runs = [Poses(Path(name), q, points, False) for name, points in (("a", xyz), ("b", again))]
    (warning,) = check_new(runs[:1], runs[1:])
    assert "b: " in warning
