"""A model that was calibrated from few noisy poses: on another day, only what is beyond its covariance is named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io import InputError
from arm_model import Arm, read_model
from diagnosis.measurements.tracker.causes import tracked_causes
from tests.diagnosis.tracked_arm import TARGET, Puma, Wrong, recordings

POSES, NOISE = 24, 5e-4
"""Of the calibration; noise in m per coordinate."""


def errors(seed: int) -> np.ndarray:
    """(6, 5) by which the arm differs from its nominal model, rad and m."""
    rng, dh = np.random.default_rng(seed), np.zeros((6, 5))
    dh[1:, 0], dh[1:, 1] = 2e-3 * rng.normal(size=5), 5e-4 * rng.normal(size=5)
    dh[:, 2], dh[:5, 3] = 5e-4 * rng.normal(size=6), 1e-3 * rng.normal(size=5)
    return dh


def calibrated(root: Path, folder: Path, seed: int) -> Path:
    """The folder of a calibration of the arm ``errors(seed)``."""
    puma, rng = Puma(root), np.random.default_rng(1000 + seed)
    q = puma.limits.mean(axis=1) + 0.3 * np.ptp(puma.limits, axis=1) * rng.uniform(-1, 1, (POSES, 6))
    xyz = puma.seen(q, Wrong(dh=errors(seed))) + NOISE * rng.normal(size=(POSES, 3))
    names = ",".join([*(f"q{j}" for j in range(1, 7)), "x", "y", "z"])
    np.savetxt(folder / "poses.csv", np.column_stack([q, xyz]), delimiter=",", header=names, comments="")
    known = armscope.Tracker(target=(TARGET[0], TARGET[1], TARGET[2]))
    model = root / "config/models/puma560.toml"
    result = armscope.calibrate(folder / "poses.csv", model, tracker=known, geometry_only=True)
    result.write(folder / "out")
    return folder / "out"


def test_a_calibration_writes_how_well_the_geometry_is_known(root: Path, tmp_path: Path) -> None:
    out = calibrated(root, tmp_path, 1)
    arm = read_model(out / "model.toml")
    known, table = arm.kinematic_uncertainty, json.loads((out / "kinematics.json").read_text())
    assert known is not None and 'kinematic_uncertainty = "model_kinematic_' in (out / "model.toml").read_text()
    for name, std in zip(known.parameters, np.sqrt(np.diag(known.matrix))):
        joint, _, value = name.partition(".")
        if joint.startswith("joint"):
            assert std == pytest.approx(table["parameters"][int(joint[5:]) - 1]["std"][value], rel=1e-5)
    # within it are the errors of the arm that the points decided
    truth = errors(1)[1:, 2] + [joint.a for joint in read_model(root / "config/models/puma560.toml").joints[1:]]
    for j, true in enumerate(truth, 2):
        std = table["parameters"][j - 1]["std"]["a"]
        assert abs(arm.joints[j - 1].a - true) < 4 * std

    beside = out / "model_kinematic_uncertainty.json"
    beside.write_text(beside.read_text().replace('"joint2.a"', '"joint9.a"'))
    with pytest.raises(InputError, match="joint9.a: no geometric parameter of this model"):
        read_model(out / "model.toml")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_second_day_names_only_what_is_beyond_it(root: Path, tmp_path: Path, seed: int) -> None:
    arm = read_model(calibrated(root, tmp_path, seed) / "model.toml")
    assert _named(root, tmp_path, arm, errors(seed), seed) == []
    # taken as exact, its own errors are news
    assert _named(root, tmp_path, replace(arm, kinematic_uncertainty=None), errors(seed), seed)
    longer = errors(seed)
    longer[1, 2] += 4e-3
    assert _named(root, tmp_path, arm, longer, seed) == [("link_geometry", 2)]


def _named(root: Path, folder: Path, arm: Arm, dh: np.ndarray, seed: int) -> list[tuple[str, int | None]]:
    fit, held_out = recordings(Puma(root), folder, Wrong(dh=dh), 40 + seed)
    return [cause.key for cause in tracked_causes(arm, fit, held_out).causes]
