"""Corrected kinematics and the ISO cube."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.rigid_body.kinematics import forward
from experiment import demand_of
from identification.kinematics.data.recordings import gravity_of
from identification.kinematics.data.runs import Run
from identification.kinematics.estimation.extensions import Extension
from identification.kinematics.use.correction import Corrected, corrected_forward, corrected_inverse, corrected_targets
from identification.kinematics.use.iso_cube import (
    cube_experiment,
    cube_points,
    cube_report,
    cube_targets,
    posture_of,
    standstills,
)

sys.path.insert(0, str(Path(__file__).parent))
from arms import puma, with_errors


@pytest.fixture(scope="module")
def arms(root: Path):
    nominal = puma(root)
    true = with_errors(nominal, np.random.default_rng(21))
    extensions = (Extension("link_sag", 2), Extension("transmission_coupling", 3, by=2))
    return nominal, Corrected(true, extensions, (2e-5, 0.004), gravity_of(true))


def some_poses(count: int) -> np.ndarray:
    """Away from singular poses, next to which a planned pose may be out of the real arm's reach."""
    return np.array([0.0, 0.6, -0.6, 0.0, 0.8, 0.0]) + np.random.default_rng(22).uniform(-0.4, 0.4, (count, 6))


def test_inverse_undoes_forward(arms) -> None:
    _, model = arms
    for q in some_poses(10):
        np.testing.assert_allclose(corrected_inverse(model, corrected_forward(model, q)[0], q + 0.05), q, atol=1e-7)


def test_a_corrected_target_brings_the_real_arm_to_the_planned_pose(arms) -> None:
    nominal, model = arms
    q = some_poses(10)
    planned, off = forward(nominal, q), corrected_forward(model, q)
    assert np.linalg.norm((planned - off)[:, :3, 3], axis=1).min() > 1e-3
    np.testing.assert_allclose(corrected_forward(model, corrected_targets(nominal, model, q)), planned, atol=1e-8)


def test_out_of_reach_names_the_target(arms) -> None:
    _, model = arms
    far = np.eye(4)
    far[:3, 3] = 5.0
    with pytest.raises(InputError, match="cannot be reached"):
        corrected_inverse(model, far, some_poses(1)[0])


def test_cube_points_lie_in_a_diagonal_plane() -> None:
    points = cube_points([0.5, 0.1, 0.8])
    assert (
        np.abs(np.linalg.det(np.column_stack((points[1] - points[0], points[2] - points[0], points[3] - points[0]))))
        < 1e-12
    )
    np.testing.assert_allclose(np.abs(points[1:] - points[0]), 0.2)
    np.testing.assert_allclose(points[1] + points[3], 2 * points[0])


def test_cube_report_shows_errors_and_overshoot(arms) -> None:
    """A run over the cube in which the arm, at each point, goes 2 mm too far along its way before it settles."""
    nominal, model = arms
    posture = posture_of(nominal)
    centre = forward(nominal, posture)[:3, 3]
    targets = cube_targets(nominal, centre, 0.5, posture)
    np.testing.assert_allclose(forward(nominal, targets)[:, :3, 3], cube_points(centre), atol=1e-8)
    demand = demand_of(cube_experiment(targets))
    t = np.arange(0, demand.duration, 0.01)
    q = demand(t)
    xyz = corrected_forward(model, q)[:, :3, 3]
    run = Run("cube", t, q, xyz.copy())
    stops = standstills(run)
    assert len(stops) == 6
    for first, _ in stops[1:]:
        way = xyz[first + 1] - xyz[first - 15]
        run.xyz[first + 5 : first + 9] += 2e-3 * way / np.linalg.norm(way)
    report = cube_report(run, forward(nominal, q)[:, :3, 3], xyz)
    assert report is not None
    assert report.before.min() > 1e-3
    assert report.after.max() < 1e-6
    np.testing.assert_allclose(report.overshoot, 2e-3, rtol=0.1)
    assert cube_report(Run("still", t[:50], q[:50], xyz[:50]), xyz[:50], xyz[:50]) is None
