"""Estimation from points: on random arms, with outliers, and with deviations that mean what they say."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.map_estimation import fit
from identification.kinematics.estimation.observability import identifiable
from identification.kinematics.models.chain import position
from identification.kinematics.models.parameters import (
    Target,
    Trust,
    base_pose,
    calibrated_arm,
    chain_of,
    parameters_of,
)

sys.path.insert(0, str(Path(__file__).parent))
from arms import NOISE, TARGET, puma, random_poses, seen, with_errors


def estimate(arm, q, xyz):
    parameters = parameters_of(arm, [Target(TARGET)], frame_known=True, trust=Trust())
    return parameters, fit(parameters, Points(q, xyz))


def test_the_chain_is_the_arm(root: Path) -> None:
    generator = np.random.default_rng(0)
    arm = with_errors(puma(root), generator)
    q = random_poses(arm, 20, generator)
    np.testing.assert_allclose(position(chain_of(arm, TARGET), q), seen(arm, q), atol=1e-12)


def test_a_modified_arm_is_calibrated_in_its_own_convention(root: Path) -> None:
    generator = np.random.default_rng(1)
    nominal = puma(root)
    nominal = replace(nominal, joints=tuple(replace(j, convention="modified") for j in nominal.joints))
    true = replace(nominal, joints=tuple(replace(j, theta=0.01, a=j.a + 1e-3) for j in nominal.joints))
    q, unseen = random_poses(nominal, 80, generator), random_poses(nominal, 80, generator)
    parameters, found = estimate(nominal, q, seen(true, q))
    arm = calibrated_arm(nominal, parameters.chain.at(found.values), frame_known=True)
    assert np.abs(seen(arm, unseen) - seen(true, unseen)).max() < 1e-5  # priors hold the rest


def test_reaches_the_noise_floor_on_random_arms(root: Path) -> None:
    """The goal: held-out rms <= 1.1 sigma sqrt(1 + p / N) and 98 % better, on at least 95 of 100 arms.

    N coordinates measured.
    """
    nominal, poses = puma(root), 60
    reached = better = 0
    for seed in range(100):
        generator = np.random.default_rng(seed)
        true = with_errors(nominal, generator, 0.02, 0.003)
        q, unseen = random_poses(nominal, poses, generator), random_poses(nominal, 200, generator)
        parameters, found = estimate(nominal, q, seen(true, q) + generator.normal(size=(poses, 3)) * NOISE)
        measured = seen(true, unseen) + generator.normal(size=(200, 3)) * NOISE
        after = np.sqrt(np.mean((measured - position(parameters.chain.at(found.values), unseen)) ** 2))
        before = np.sqrt(np.mean((measured - seen(nominal, unseen)) ** 2))
        reached += after <= 1.1 * NOISE * np.sqrt(1 + 27 / (3 * poses))
        better += after < 0.02 * before
    assert reached >= 95
    assert better >= 95


def test_wrong_points_are_left_out(root: Path) -> None:
    generator = np.random.default_rng(3)
    nominal = puma(root)
    true = with_errors(nominal, generator)
    q = random_poses(nominal, 200, generator)
    xyz = seen(true, q) + generator.normal(size=(200, 3)) * NOISE
    wrong = generator.random(200) < 0.2
    xyz[wrong] += generator.normal(size=(wrong.sum(), 3)) * 0.3
    parameters, found = estimate(nominal, q, xyz)
    assert not found.inlier[wrong].any()
    assert found.inlier[~wrong].mean() > 0.98
    unseen = random_poses(nominal, 200, generator)
    assert (
        np.sqrt(np.mean((seen(true, unseen) - position(parameters.chain.at(found.values), unseen)) ** 2)) < 0.6 * NOISE
    )


def test_deviations_are_those_of_the_estimates(root: Path) -> None:
    """Estimates of well-determined values scatter as their standard deviations say: chi-square, 60 trials each."""
    generator = np.random.default_rng(4)
    nominal = puma(root)
    true = with_errors(nominal, generator)
    q = random_poses(nominal, 100, generator)
    names, values, deviations = [], [], []
    for _ in range(60):
        parameters, found = estimate(nominal, q, seen(true, q) + generator.normal(size=(100, 3)) * NOISE)
        names = [parameters.chain.names[k] for k in parameters.free]
        values.append(found.values[parameters.free])
        deviations.append(np.sqrt(np.diag(found.covariance)))
    ratio = np.std(values, axis=0) / np.mean(deviations, axis=0)
    checked = [
        r
        for name, r in zip(names, ratio)
        if name in ("joint2.theta", "joint2.a", "joint3.alpha", "joint4.d", "base.x", "joint2.beta")
    ]
    assert len(checked) == 6
    assert all(0.7 < r < 1.35 for r in checked)


@pytest.mark.parametrize(("moving", "expected"), [(6, 27), (3, 15)])
def test_identifiable_parameters_are_counted(root: Path, moving: int, expected: int) -> None:
    arm, generator = puma(root), np.random.default_rng(5)
    q = random_poses(arm, 200, generator)
    q[:, moving:] = 0.3 + 1e-5 * generator.normal(size=(200, 6 - moving))  # resting encoders flicker
    parameters = parameters_of(arm, [Target(TARGET)], frame_known=True, trust=Trust())
    assert identifiable(parameters, q) == expected


def test_a_short_arm_has_fifteen(root: Path) -> None:
    arm = puma(root)
    arm = replace(arm, joints=arm.joints[:3], controller=None)
    q = random_poses(arm, 50, np.random.default_rng(6))
    assert identifiable(parameters_of(arm, [Target(TARGET)], frame_known=True, trust=Trust()), q) == 15


def test_what_is_known_decides_between_base_and_joint_one(root: Path) -> None:
    generator = np.random.default_rng(7)
    nominal = puma(root)
    first = replace(nominal.joints[0], theta=0.02)
    true = replace(nominal, joints=(first, *nominal.joints[1:]))
    q = random_poses(nominal, 60, generator)
    for known in (True, False):
        parameters = parameters_of(nominal, [Target(TARGET)], frame_known=known, trust=Trust())
        chain = parameters.chain.at(fit(parameters, Points(q, seen(true, q))).values)
        theta = {s.name: s.value for s in chain.steps}["joint1.theta"]
        turned = base_pose(chain)
        assert theta == pytest.approx(0.02 if known else 0.0, abs=1e-4)
        assert np.arctan2(turned[1, 0], turned[0, 0]) == pytest.approx(0.0 if known else 0.02, abs=1e-4)


def test_placed_arms_are_refused(root: Path) -> None:
    arm = puma(root)
    arm = replace(arm, joints=tuple(replace(j, convention="placed", theta=0, d=0, a=0, alpha=0) for j in arm.joints))
    with pytest.raises(InputError, match=r"joint\[1\].*D-H"):
        parameters_of(arm, [Target(TARGET)], frame_known=True, trust=Trust())


def test_of_nothing_that_is_free_the_residual_is_told(root: Path) -> None:
    """A gear so soft that frame and target may not make up for it left a matrix without columns, and a traceback."""
    generator = np.random.default_rng(3)
    arm = puma(root)
    q = random_poses(arm, 30, generator)
    known = parameters_of(arm, [Target(TARGET)], frame_known=True, trust=Trust())
    off = np.array([0.003, 0.0, -0.004])
    found = fit(replace(known, free=known.free[:0]), Points(q, seen(arm, q) + off))
    np.testing.assert_array_equal(found.values, known.chain.values)
    assert found.covariance.shape == (0, 0)
    assert found.inlier.all()
    assert found.noise == pytest.approx(np.linalg.norm(off) / np.sqrt(3.0))
