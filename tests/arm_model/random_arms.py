"""Random serial arms for identity tests.

Every convention, revolute and prismatic joints, tilted bases, physical links.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_model.description import Arm, Joint
from arm_model.rigid_body.kinematics import roll_pitch_yaw
from arm_model.tables.link_shapes import Cylinder


def random_joint(rng: np.random.Generator, *, friction: bool = True) -> Joint:
    points, weights = rng.normal(size=(6, 3)) * 0.2, rng.uniform(0.2, 2.0, size=6)
    com = (weights @ points) / weights.sum()
    arms = points - com
    second = (weights[:, None, None] * arms[:, :, None] * arms[:, None, :]).sum(axis=0)
    inertia = np.trace(second) * np.eye(3) - second
    convention = rng.choice(["standard", "modified", "placed"])
    if convention == "placed":
        axis = rng.normal(size=3)
        place = dict(
            xyz=tuple(rng.normal(size=3) * 0.4), rpy=tuple(rng.normal(size=3)), axis=tuple(axis / np.linalg.norm(axis))
        )
    else:
        names = ("theta", "d", "a", "alpha", "beta")
        place = dict(zip(names, rng.choice([0.0, 0.3, np.pi / 2, -0.7], size=5)))
    drive = dict(
        gear=float(rng.choice([-40.0, 1.0, 70.0])),
        rotor_inertia=2e-4,
        viscous=(1e-3, 1.7e-3),
        coulomb=tuple(rng.uniform(0.0, 0.3, size=2)),
        offset=0.02,
    )
    return Joint(
        type=rng.choice(["revolute", "revolute", "prismatic"]),
        convention=convention,
        mass=float(weights.sum()),
        com=tuple(com),
        inertia=tuple(inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))),
        **place,
        **(drive if friction else {}),
    )


def random_cylinder(rng: np.random.Generator) -> Cylinder:
    ends = rng.normal(size=(2, 3)) * 0.3
    names = ("radius", "drag_coefficient", "added_mass_coefficient", "buoyancy")
    start, end = (tuple(map(float, point)) for point in ends)
    return Cylinder(start, end, **dict(zip(names, rng.uniform([0.02, 0.5, 0.5, 0.5], [0.05, 1.5, 2.0, 1.0]))))


def in_water(arm: Arm, seed: int) -> Arm:
    """The arm with water round two of its links, and a drag on the joint of another."""
    rng = np.random.default_rng(seed + 2000)
    first, second, third = rng.permutation(len(arm))[:3]
    joints = list(arm.joints)
    for j in (first, second):
        joints[j] = replace(joints[j], cylinder=random_cylinder(rng))
    joints[third] = replace(joints[third], drag=0.7)
    return replace(arm, joints=tuple(joints))


def random_arm(seed: int, *, joints: int = 4, friction: bool = True) -> Arm:
    rng = np.random.default_rng(seed)
    base = roll_pitch_yaw(tuple(rng.normal(size=3)))
    base[:3, 3] = rng.normal(size=3)
    return Arm(
        name=f"random {seed}",
        joints=tuple(random_joint(rng, friction=friction) for _ in range(joints)),
        base=tuple(tuple(map(float, row)) for row in base),
    )


def random_states(seed: int, joints: int, count: int = 20) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed + 1000)
    return rng.normal(size=(count, joints)), rng.normal(size=(count, joints)), 5 * rng.normal(size=(count, joints))
