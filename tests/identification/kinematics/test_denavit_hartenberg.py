"""An arm placed as in URDF and the same in D-H: one kinematics, one dynamics, and one calibration."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm, Joint
from arm_model.rigid_body.kinematics import forward, link_frames
from arm_model.system.dynamics import inverse_dynamics
from arm_model.urdf import read_urdf, write_urdf
from identification.kinematics.models.denavit_hartenberg import in_denavit_hartenberg

sys.path.insert(0, str(Path(__file__).parent))
from arms import puma


def placed(generator: np.random.Generator, joints: int = 6) -> Arm:
    """Joints anywhere, about any axis."""
    every = [
        Joint(
            convention="placed",
            mass=float(generator.uniform(1, 5)),
            com=tuple(generator.uniform(-0.1, 0.1, 3)),
            inertia=(0.1, 0.12, 0.11, 0.01, 0.0, -0.01),
            xyz=tuple(generator.uniform(-0.4, 0.4, 3)),
            rpy=tuple(generator.uniform(-2, 2, 3)),
            axis=tuple(generator.normal(size=3)),
            rotor_inertia=1e-4,
            gear=50.0,
        )
        for _ in range(joints)
    ]
    return Arm(name="placed", joints=tuple(every))


def the_same(arm: Arm, other: Arm, moved: np.ndarray) -> None:
    generator = np.random.default_rng(5)
    q, v, a = generator.uniform(-2, 2, (3, 20, len(arm)))
    np.testing.assert_allclose(forward(arm, q), forward(other, q), atol=1e-9)
    np.testing.assert_allclose(link_frames(arm, q)[:, -1], link_frames(other, q)[:, -1] @ moved, atol=1e-9)
    np.testing.assert_allclose(inverse_dynamics(arm, q, v, a), inverse_dynamics(other, q, v, a), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_any_placed_arm_has_d_h_parameters_and_moves_the_same(seed: int) -> None:
    arm = placed(np.random.default_rng(seed))
    other, moved = in_denavit_hartenberg(arm)
    assert {joint.convention for joint in other.joints} == {"standard"}
    the_same(arm, other, moved)


def test_the_puma_through_urdf_and_back(root: Path, tmp_path: Path) -> None:
    arm = puma(root)
    assert in_denavit_hartenberg(arm)[0] is arm
    write_urdf(tmp_path / "puma.urdf", arm)
    there = read_urdf(tmp_path / "puma.urdf")
    other, moved = in_denavit_hartenberg(there)
    the_same(there, other, moved)
    assert other.joints[1].alpha == pytest.approx(0.0, abs=1e-9)  # parallel axes, as in the model file
    assert other.joints[1].a == pytest.approx(arm.joints[1].a)


def test_a_mass_point_in_the_origin_of_its_new_frame_has_no_inertia() -> None:
    """By way of the old frame's origin, far from the point, rounding would leave it one, and a negative one."""
    arm = placed(np.random.default_rng(5))

    def in_new_frames(coms: Sequence[np.ndarray]) -> Arm:
        points = zip(arm.joints, coms)
        bodies = tuple(replace(joint, mass=87.0, com=tuple(com), inertia=(0.0,) * 6) for joint, com in points)
        return in_denavit_hartenberg(replace(arm, joints=bodies))[0]

    origin, *turned = (np.array([j.com for j in in_new_frames([com] * 6).joints]) for com in np.eye(4, 3, k=-1))
    rotations = np.stack([one - origin for one in turned], axis=-1)
    there = in_new_frames([-rotation.T @ shift for rotation, shift in zip(rotations, origin)])
    assert max(np.abs(joint.com).max() for joint in there.joints) < 1e-12
    assert all(np.abs(joint.inertia).max() == 0.0 for joint in there.joints)
