"""What a tracker sees of an arm with effects, against transforms and moments written out here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm_io import InputError
from arm_model.description import Arm, EffectTerm, Joint
from arm_model.geometry import relinked
from arm_model.simulation.simulation import simulate
from arm_model.system.dynamics import inverse_dynamics
from arm_model.tracking import latency, target_at, tracked
from tests.arm_model.pumas import swing, three_links

POINT = (0.05, 0.0, 0.10)
LENGTH, MASS = 0.5, 4.0


def pendulum(*effects: EffectTerm) -> Arm:
    """One link of 0.5 m about the horizontal y axis, 4 kg at its end; the target is there too."""
    base = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    return Arm(name="pendulum", joints=(Joint(a=LENGTH, mass=MASS),), base=base, effects=effects)


def test_a_link_hangs_by_its_moment_times_the_compliance() -> None:
    q = np.linspace(-1.0, 1.0, 9)[:, None]
    compliance = 1e-3
    bent = target_at(pendulum(EffectTerm("link_sag", 1, {"compliance": compliance})), q, (0.0, 0.0, 0.0))
    # N m about the joint; the base's z axis is the world's y, so q > 0 points down
    down = 9.80665 * MASS * LENGTH * np.cos(q[:, 0])
    hanging = q[:, 0] + compliance * down
    np.testing.assert_allclose(
        bent, LENGTH * np.column_stack([np.cos(hanging), 0 * hanging, -np.sin(hanging)]), atol=1e-12
    )


def test_geometry_is_the_d_h_transform_with_the_errors_in_it(puma: Arm) -> None:
    errors = {"d_theta": 0.01, "d_alpha": -0.02, "d_a": 0.003, "d_d": 0.002, "beta": 0.005}
    q = np.random.default_rng(1).uniform(-1, 1, (5, len(puma)))
    joint = puma.joints[1]
    values = {
        "theta": joint.theta + 0.01,
        "alpha": joint.alpha - 0.02,
        "a": joint.a + 0.003,
        "d": joint.d + 0.002,
        "beta": joint.beta + 0.005,
    }
    other = replace(puma, joints=(puma.joints[0], replace(joint, **values), *puma.joints[2:]))
    bent = replace(puma, effects=(EffectTerm("link_geometry", 2, errors),))
    np.testing.assert_allclose(target_at(bent, q, POINT), target_at(other, q, POINT), atol=1e-12)
    # the dynamics are those of the other arm, too
    speed, rate = q[::-1], 2 * q
    np.testing.assert_allclose(
        inverse_dynamics(bent, q, speed, rate), inverse_dynamics(other, q, speed, rate), rtol=1e-9
    )
    zero = replace(puma, effects=(EffectTerm("joint_zero_offset", 2, {"offset": -0.01}),))
    turned = replace(puma, effects=(EffectTerm("link_geometry", 2, {"d_theta": 0.01}),))
    np.testing.assert_allclose(target_at(zero, q, POINT), target_at(turned, q, POINT), atol=1e-12)


def test_servos_stay_those_of_the_arm_as_described(puma: Arm) -> None:
    arm = three_links(puma)
    bent = relinked(replace(arm, effects=(EffectTerm("link_geometry", 2, {"d_a": 0.05}),)))
    assert bent.effects == ()
    assert bent.controller is not None
    plain = simulate(arm, swing(3), duration=0.2, rate=200)
    other = simulate(
        replace(arm, effects=(EffectTerm("link_geometry", 2, {"d_a": 0.05}),)), swing(3), duration=0.2, rate=200
    )
    assert 1e-4 < np.abs(plain.current - other.current).max() < 5.0
    placed = replace(arm, joints=(Joint(convention="placed"), *arm.joints[1:]), controller=None)
    with pytest.raises(InputError, match="needs D-H parameters"):
        relinked(replace(placed, effects=(EffectTerm("link_geometry", 1, {"d_a": 0.05}),)))


def test_late_points_are_earlier_ones_and_wrong_ones_are_as_many_as_said(puma: Arm) -> None:
    t = np.arange(0.0, 2.0, 0.005)
    q = 0.3 * np.sin(2 * t)[:, None] * np.ones(len(puma))
    late = replace(puma, effects=(EffectTerm("tracker_latency", None, {"delay": 0.01}),))
    assert latency(late) == 0.01
    np.testing.assert_allclose(tracked(late, t, q, POINT)[10:], target_at(puma, q, POINT)[8:-2], atol=1e-9)
    wrong = replace(puma, effects=(EffectTerm("tracker_outliers", None, {"share": 0.05, "size": 0.02}),))
    off = np.linalg.norm(tracked(wrong, t, q, POINT) - target_at(puma, q, POINT), axis=1)
    assert off[off > 1e-9] == pytest.approx(0.02)
    assert 0.02 < np.mean(off > 1e-9) < 0.09
