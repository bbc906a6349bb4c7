"""Circles of single-joint sweeps: features, residuals, and sweeps that determine nothing."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.kinematics.circle_points.axes import circle_point_model
from identification.kinematics.circle_points.circle_point import DegenerateSweep, fit_circle
from identification.kinematics.circle_points.sweeps import circles_of, find_sweeps
from identification.kinematics.models.chain import position
from identification.kinematics.models.parameters import Target, Trust, chain_of, parameters_of

sys.path.insert(0, str(Path(__file__).parent))
from arms import NOISE, TARGET, puma, random_poses, seen, sweeps, with_errors

AT = np.array([0.1, 0.2, 1.3, 0.2, 0.3, 0.1])


def arc(n: int = 200, degrees: float = 120.0, radius: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """One joint's q (n, 1) and points on a circle about (1, 2, 3), axis (0, 0.6, 0.8)."""
    q = np.linspace(0, np.radians(degrees), n)
    x, y = np.array([1.0, 0, 0]), np.array([0, 0.8, -0.6])
    return q[:, None], np.array([1.0, 2, 3]) + radius * (np.outer(np.cos(q + 0.4), x) + np.outer(np.sin(q + 0.4), y))


def test_a_circle_is_found_again() -> None:
    q, xyz = arc()
    circle = fit_circle(q, xyz, 1)
    np.testing.assert_allclose(circle.axis, [0, 0.6, 0.8], atol=1e-9)
    np.testing.assert_allclose(circle.centre, [1, 2, 3], atol=1e-9)
    assert circle.radius == pytest.approx(0.6)
    np.testing.assert_allclose(circle.zero, [np.cos(0.4), 0.8 * np.sin(0.4), -0.6 * np.sin(0.4)], atol=1e-9)


def test_deviations_of_axis_and_centre_hold() -> None:
    generator = np.random.default_rng(1)
    q, xyz = arc(60, 60.0)
    axes, centres, std = [], [], []
    for _ in range(80):
        circle = fit_circle(q, xyz + generator.normal(size=xyz.shape) * NOISE, 1)
        axes.append(circle.axis)
        centres.append(circle.centre)
        std.append((circle.std_angle, circle.std_centre))
    # worst directions: largest principal deviation of the scatter
    spread = [np.sqrt(np.linalg.eigvalsh(np.cov(np.array(v).T))[-1]) for v in (axes, centres)]
    assert spread[0] == pytest.approx(np.mean(std, axis=0)[0], rel=0.3)
    assert spread[1] == pytest.approx(np.mean(std, axis=0)[1], rel=0.3)


def test_eccentricity_shows_along_the_path_only() -> None:
    q, _ = arc(400, 300.0)
    wrong = q + 1e-3 * np.sin(q + 0.7)
    _, xyz = arc(400, 300.0)
    circle = fit_circle(wrong, xyz, 1)
    amplitude, _, share = circle.once_a_turn()
    assert amplitude == pytest.approx(1e-3, rel=0.05)
    assert share > 0.99
    assert circle.rms["radial"] < 1e-9 < 1e-4 < circle.rms["tangential"]


def test_wrong_points_do_not_bend_it() -> None:
    generator = np.random.default_rng(2)
    q, xyz = arc()
    xyz[::10] += generator.normal(size=(20, 3)) * 0.2
    xyz[5] = np.nan
    np.testing.assert_allclose(fit_circle(q, xyz, 1).centre, [1, 2, 3], atol=1e-6)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda q, p: (q[:8], p[:8]), "8 points; expected at least 10"),
        (lambda q, p: (q[:40], p[:40]), "covers 2[0-9.]* degrees; expected at least 30"),
        (lambda q, p: (q, np.outer(q[:, 0], [1.0, 2, 3])), "on a line"),
        (lambda q, p: (np.column_stack((q[:, 0] * 0, q[:, 0])), p), "joint 2 moved instead"),
        (lambda q, p: (np.column_stack((q[:, 0], q[:, 0] / 20)), p), "joint 2 moved too"),
        (lambda q, p: (q * 2, p), "turned 0.5 times as far"),
    ],
)
def test_degenerate_sweeps_are_refused_with_the_reason(spoil, reason) -> None:
    q, xyz = spoil(*arc())
    with pytest.raises(DegenerateSweep, match=reason):
        fit_circle(q, xyz, 1)


def test_sweeps_are_found_in_a_recording() -> None:
    q = sweeps((3, 2, 1), AT, 1.5)
    assert [(s.joint, round(s.travel, 1)) for s in find_sweeps(q)] == [(3, 1.5), (2, 1.5), (1, 1.5)]


def test_circles_alone_give_the_arm_when_target_and_joints_are_ideal(root: Path) -> None:
    """Without noise, sag or a misplaced target, features of all six sweeps are the arm: whatever its pose meanwhile."""
    nominal = puma(root)
    true = with_errors(nominal, np.random.default_rng(3))
    last = nominal.joints[5]  # the last link cannot be distinguished from the target
    true = replace(true, joints=(*true.joints[:5], replace(true.joints[5], a=last.a, d=last.d, alpha=last.alpha)))
    q = sweeps((1, 2, 3, 4, 5, 6), AT, 1.5)
    circles, refused = circles_of(q, seen(true, q))
    assert [c.joint for c in circles] == [6, 5, 4, 3, 2, 1]
    assert not refused
    chain = chain_of(nominal, TARGET)
    unseen = random_poses(nominal, 100, np.random.default_rng(4))
    found = position(chain.at(circle_point_model(circles, chain)), unseen)
    np.testing.assert_allclose(found, seen(true, unseen), atol=1e-7)
    assert len(parameters_of(nominal, [Target(TARGET)], frame_known=True, trust=Trust()).every) == 39
