"""Pose selection, observability indices, and the experiment that visits the poses."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.rigid_body.kinematics import link_frames
from experiment import demand_of, read_experiment, write_experiment
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.map_estimation import fit
from identification.kinematics.estimation.observability import indices, scaled_jacobian, singular_values
from identification.kinematics.models.chain import position
from identification.kinematics.models.parameters import Target, Trust, parameters_of
from identification.kinematics.use.poses import experiment_of, select_poses

sys.path.insert(0, str(Path(__file__).parent))
from arms import NOISE, TARGET, puma, random_poses, seen, with_errors


@pytest.fixture(scope="module")
def plan(root: Path):
    return select_poses(puma(root), TARGET, 30, noise=NOISE, candidates=600)


def test_selected_poses_beat_random_ones(root: Path, plan) -> None:
    arm = puma(root)
    parameters = parameters_of(arm, [Target(TARGET)], frame_known=True, trust=Trust())

    def information(q: np.ndarray) -> float:
        columns = scaled_jacobian(parameters, q).reshape(-1, len(parameters.free)) / NOISE
        return float(np.linalg.slogdet(columns.T @ columns + np.eye(columns.shape[1]))[1])

    generator = np.random.default_rng(1)
    assert information(plan.q) > max(information(random_poses(arm, 30, generator)) for _ in range(20))
    assert plan.error[-1] < plan.random
    assert plan.identifiable == 27


def test_promised_error_is_the_error(root: Path, plan) -> None:
    """Simulated calibrations from the selected poses miss by what was promised (rms over trials and workspace)."""
    nominal, squares = puma(root), []
    generator = np.random.default_rng(2)
    parameters = parameters_of(nominal, [Target(TARGET)], frame_known=True, trust=Trust())
    for _ in range(12):
        true = with_errors(nominal, generator)
        found = fit(parameters, Points(plan.q, seen(true, plan.q) + generator.normal(size=plan.q[:, :3].shape) * NOISE))
        q = random_poses(nominal, 300, generator)
        squares.append(np.mean((position(parameters.chain.at(found.values), q) - seen(true, q)) ** 2))
    assert np.sqrt(np.mean(squares)) == pytest.approx(plan.error[-1], rel=0.35)


def test_error_falls_with_poses_and_enough_is_where_it_reaches_the_noise(plan) -> None:
    assert (np.diff(plan.error) < 1e-12).all()
    if plan.enough is not None:
        assert plan.error[plan.enough - 1] <= 0.46 * NOISE < plan.error[plan.enough - 2]


def test_poses_keep_off_the_floor(root: Path, plan) -> None:
    frames = link_frames(puma(root), plan.q)
    assert frames[:, 2:, 2, 3].min() > 0.05


def test_indices_are_their_definitions() -> None:
    columns = np.random.default_rng(3).normal(size=(60, 7))
    s = np.linalg.svd(columns, compute_uv=False)
    np.testing.assert_allclose(singular_values(columns), s, rtol=1e-12)
    o = indices(columns, 7, 20)
    assert o.o1 == pytest.approx(np.prod(s) ** (1 / 7) / np.sqrt(20))
    assert (o.o2, o.o3, o.o4) == pytest.approx((s[-1] / s[0], s[-1], s[-1] ** 2 / s[0]))
    assert o.o5 == pytest.approx(1 / np.sum(1 / s))
    assert indices(np.zeros((9, 3)), 3, 3).o1 == 0.0


def test_the_experiment_visits_every_pose_within_the_tracker_memory(root: Path, plan, tmp_path: Path) -> None:
    arm = puma(root)
    write_experiment(tmp_path / "poses.toml", experiment_of(arm, plan, rows=1000))
    experiment = read_experiment(tmp_path / "poses.toml")
    demand = demand_of(experiment)
    q = demand(np.arange(0, demand.duration, 0.05))
    for pose in plan.q:
        assert np.abs(q - pose).max(axis=1).min() < 1e-5
    assert experiment.rate is not None
    assert experiment.rate * demand.duration <= 1000


def test_too_few_poses_are_refused(root: Path) -> None:
    with pytest.raises(InputError, match="at least 2"):
        select_poses(puma(root), TARGET, 1)
