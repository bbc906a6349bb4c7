"""Random arms on random floating bases, and random states of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_model.description import Arm
from arm_model.moving_base.numeric import BaseRows
from arm_model.tables import FloatingBase, Thruster
from tests.arm_model.random_arms import in_water, random_arm, random_joint


def random_base(seed: int, *, water: bool) -> FloatingBase:
    """A physical body of about 10 kg, in water or not, with two thrusters, one of which gives 80 %."""
    rng = np.random.default_rng(seed + 3000)
    body = random_joint(rng, friction=False)
    thrusters = (
        Thruster((1.0, 0.0, 0.2), (0.0, 1.0, 0.0), (-20.0, 20.0)),
        Thruster((0.0, 1.0, 0.0), (0.0, 1.0, 1.0), (-20.0, 20.0), gain=0.8),
    )
    dry = FloatingBase(mass=body.mass, com=body.com, inertia=body.inertia, thruster=thrusters)
    if not water:
        return dry
    half = rng.normal(size=(6, 6))
    added = (half @ half.T).tolist()
    linear, quadratic = (tuple(map(float, row)) for row in rng.uniform(0.0, 5.0, (2, 6)))
    return replace(
        dry,
        added_mass=added,
        linear_drag=linear,
        quadratic_drag=quadratic,
        displaced_mass=body.mass + 1.0,
        buoyancy_centre=(0.05, -0.02, 0.1),
    )


def floating_arm(seed: int, *, joints: int = 4, water: bool = False, friction: bool = False) -> Arm:
    arm = replace(random_arm(seed, joints=joints, friction=friction), floating=random_base(seed, water=water))
    return in_water(arm, seed) if water else arm


def random_rows(seed: int, count: int = 20) -> BaseRows:
    rng = np.random.default_rng(seed + 4000)
    attitude = rng.normal(size=(count, 4))
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    return BaseRows(attitude, rng.normal(size=(count, 6)), 3 * rng.normal(size=(count, 6)))
