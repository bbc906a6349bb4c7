"""The uncertainty that a calibration states, its residuals point by point, and poses that were visited again."""

from __future__ import annotations

import csv
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from identification.kinematics.report.budget import uncertainty

sys.path.insert(0, str(Path(__file__).parent))
from foreign_arm import DESCRIPTION, NOISE, ForeignArm

POSES, VISITS, JUDGED = 40, 5, 80


def table(path: Path, q: np.ndarray, xyz: np.ndarray) -> Path:
    rows = np.column_stack((q, xyz))
    np.savetxt(path, rows, fmt="%.9f", delimiter=",", header="q1,q2,q3,q4,q5,q6,x,y,z", comments="")
    return path


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> armscope.Calibration:
    """40 poses, the first of them visited four more times, one point 30 mm off; 80 held-out poses."""
    folder, arm, generator = tmp_path_factory.mktemp("poses"), ForeignArm(seed=31), np.random.default_rng(32)
    (folder / "arm.toml").write_text(DESCRIPTION)
    q = arm.reported(POSES, generator)
    q = np.concatenate((q, np.repeat(q[:1], VISITS - 1, axis=0)))
    xyz = arm.measured(q, generator)
    xyz[20] += [0.03, 0.0, 0.0]
    fresh = arm.reported(JUDGED, generator)
    files = table(folder / "fit.csv", q, xyz), table(folder / "judge.csv", fresh, arm.measured(fresh, generator))
    return armscope.calibrate(files[0], folder / "arm.toml", held_out=files[1], geometry_only=True)


def test_the_stated_uncertainty_covers_held_out_points(found: armscope.Calibration) -> None:
    """95 % of 240 coordinates and of 80 distances, as the binomial distribution allows (three deviations)."""
    stated, points = found.to_json()["uncertainty"], found.to_pandas("points")
    judged = points[points.part == "held_out"]
    off = judged[["dx", "dy", "dz"]].to_numpy()
    assert off.shape == (JUDGED, 3)
    assert abs(np.mean(np.abs(off) < stated["expanded"]) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / off.size)
    assert abs(np.mean(judged.distance < stated["in_space"]) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / JUDGED)
    parts = {one["source"]: one["std"] for one in stated["components"]}
    assert parts["noise of the points"] == pytest.approx(NOISE, rel=0.25)
    assert 0.2 * NOISE < parts["estimated parameters"] < NOISE
    assert parts["excess of held-out points"] < 0.5 * NOISE
    assert stated["combined"] == pytest.approx(np.sqrt(sum(std**2 for std in parts.values())))


def test_a_covariance_below_zero_by_rounding_states_no_uncertainty(found: armscope.Calibration) -> None:
    """Of points without noise that hardly determine a parameter: its root was not a number, and nothing was written."""
    fit = found.details.fit
    rounded = replace(found.details, fit=replace(fit, covariance=-1e-22 * np.eye(len(fit.covariance))))
    parts = {one["source"]: one["std"] for one in uncertainty(rounded, None)["components"]}
    assert parts["estimated parameters"] == 0.0


def test_every_point_has_its_residual(found: armscope.Calibration, tmp_path: Path) -> None:
    """Also the one that the fit left out; the table agrees with the errors that the result states."""
    found.write(tmp_path / "out")
    rows = list(csv.DictReader((tmp_path / "out" / "residuals.csv").open(encoding="utf-8")))
    assert len(rows) == POSES + VISITS - 1 + JUDGED
    assert [row["row"] for row in rows if row["outlier"] == "1"] == ["21"]
    error = found.to_json()["position_error"]
    for part in ("fit", "held_out"):
        for when, column in (("before", "distance_before"), ("after", "distance")):
            distance = np.array([float(row[column]) for row in rows if row["part"] == part])
            assert np.sqrt(np.mean(distance**2) / 3) == pytest.approx(error[part][when]["rms"], rel=1e-6)


def test_repeated_poses_show_the_repeatability(found: armscope.Calibration) -> None:
    """Five visits of one pose: their scatter is the noise of the points, whatever the model is."""
    again = found.to_json()["uncertainty"]["repeated"]
    (pose,) = again["poses"]
    assert pose["rows"] == [1, *range(POSES + 1, POSES + VISITS)] and again["degrees_of_freedom"] == 3 * (VISITS - 1)
    assert 0.4 * NOISE < again["std"] < 1.8 * NOISE
    assert NOISE < pose["repeatability"] < 6 * NOISE
    assert pose["accuracy"]["after"] < 3 * NOISE < pose["accuracy"]["before"]
    page = found._repr_html_()
    assert "Uncertainty of a predicted position" in page and "Repeated poses" in page
