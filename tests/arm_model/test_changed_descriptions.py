"""Effects that are errors of the description: as terms they equal an arm with changed numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, described, values_of
from arm_model.rigid_body import link_frames
from arm_model.simulation.simulation import simulate
from arm_model.system.dynamics import inverse_dynamics
from tests.arm_model.random_arms import random_arm

VALUES = {
    "payload": (None, {"mass": 1.2, "x": 0.02, "y": -0.01, "z": 0.08}),
    "link_inertia": (2, {"mass": 0.8, "mx": -0.1, "my": 0.02, "ixx": 0.03, "iyy": 0.05, "izz": 0.06}),
    "rotor_inertia": (1, {"inertia": 0.4}),
    "base_tilt": (None, {"roll": 0.02, "pitch": -0.03}),
    "joint_zero_offset": (3, {"offset": 0.05}),
}


@pytest.mark.parametrize("name", VALUES)
@pytest.mark.parametrize("joint", [2, 3, 5])
def test_a_term_is_the_changed_arm(puma: Arm, name: str, joint: int) -> None:
    where, values = VALUES[name]
    where = joint if name == "joint_zero_offset" else where
    effect = CATALOGUE[name]
    assert effect.change is not None
    changed: Arm = effect.change(puma, where, values_of(effect, values))
    term = replace(puma, effects=(EffectTerm(name, where, values),))
    q, v, a = np.random.default_rng(joint).normal(size=(3, 20, 6))
    expected = inverse_dynamics(changed, q, v, a)
    assert np.allclose(inverse_dynamics(term, q, v, a), expected, rtol=1e-10, atol=1e-9)
    assert not np.allclose(inverse_dynamics(puma, q, v, a), expected, atol=1e-3)
    # and in the compiled engine: the current that holds the arm still is that of the changed arm's gravity
    pose = q[0] * 0.5
    still = simulate(term, lambda t: np.tile(pose, (len(t), 1)), duration=4.0, rate=50.0)
    held = inverse_dynamics(changed, still.qm[-1:], still.qmd[-1:], np.zeros((1, 6))) / puma.joint_array(
        "drive_constant"
    )
    assert np.allclose(still.current[-1], held[0], atol=2e-3 * np.abs(held).max())


@pytest.mark.parametrize("seed", range(8))
def test_with_a_moved_zero_the_motors_bear_the_torque_of_the_other_angle(seed: int) -> None:
    """In every convention: of joints that are placed as in URDF, the equations had no zero to move."""
    arm = random_arm(seed, joints=3)
    q = np.random.default_rng(seed).normal(size=(5, 3))
    rest = np.zeros_like(q)
    for number in range(1, 4):
        term = EffectTerm("joint_zero_offset", number, {"offset": 0.3})
        moved = inverse_dynamics(replace(arm, effects=(*arm.effects, term)), q, rest, rest)
        other = q - 0.3 * (np.arange(1, 4) == number)
        assert np.allclose(moved, inverse_dynamics(arm, other, rest, rest), atol=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_a_moved_zero_is_the_same_arm_at_other_angles(seed: int) -> None:
    """In every convention, joints placed as in URDF too: the reading is the angle plus the offset."""
    arm = random_arm(seed, joints=4)
    q = np.random.default_rng(seed).normal(size=4)
    for number in range(1, 5):
        moved = described(arm.with_effect("joint_zero_offset", number, offset=0.3))
        expected = link_frames(arm, q - 0.3 * (np.arange(1, 5) == number))
        assert np.allclose(link_frames(moved, q), expected, atol=1e-12)
