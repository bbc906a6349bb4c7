"""The wrench on a floating base as a linear function of its parameters.

    sum gain_k b_k u_k - A v' - .. - drag(v) - buoyancy - reaction (the arm's wrench) = wrench that the hull takes

What is known stands on the right, the rigid vehicle: it is weighed, not identified. Parameters by the names of
``arm_model.tables.base_values``, and of the arm ``arm.reaction``, share of its wrench on the base, 1 in a true
model, and ``arm.payload``, kg at the tool in addition to the model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.moving_base import recursion
from arm_model.moving_base.numeric import BaseRows, floating, forces_with_base
from arm_model.moving_base.recursion import DOF
from arm_model.rigid_body.inertia import about_com, barycentric
from arm_model.rigid_body.numeric import stacked
from arm_model.tables import Thruster, base_parameters

REACTION, PAYLOAD = "arm.reaction", "arm.payload"
OF_ARM = {REACTION: "1", PAYLOAD: "kg"}
"""Parameters of the arm, and their units; the others are the base's."""


def nominal_wrench_parameters(arm: Arm) -> dict[str, float]:
    """The parameters as the model has them, in the order of the columns."""
    values = {name: value for name, value in base_parameters(floating(arm)).items() if of_wrench(name)}
    return values | {REACTION: 1.0, PAYLOAD: 0.0}


def of_wrench(name: str) -> bool:
    """Whether a parameter of the base enters the wrench linearly: of a thruster its gain alone."""
    return not name.startswith("thruster") or name.endswith(".gain")


def thrust_of(demand: Array, thruster: Thruster) -> Array:
    """(..., m) N of a thruster per unit of its gain, for ``demand`` within its limits, without its time constant."""
    ahead, astern = beyond(demand, thruster.dead_zone)
    return np.asarray(thruster.forward * ahead + thruster.reverse * astern)


def beyond(demand: Array, zone: float | Array) -> tuple[Array, Array]:
    """Positive and negative part of a demand, N, of any shape, each less a dead zone, N."""
    return np.maximum(demand - zone, 0.0), np.minimum(demand + zone, 0.0)


def wrench_columns(arm: Arm, base: BaseRows, joints: tuple[Array, Array, Array], thrust: Array) -> Array:
    """(N, 6, p) N and N m per unit of each parameter; ``joints`` q, qd, qdd (N, n).

    ``thrust`` (N, thrusters) N per unit of each gain.
    """
    forces = forces_with_base(arm, base, *joints, base_water=False)[:, :DOF]
    reaction = forces - _alone(arm, base, len(forces))
    pushed = [np.outer(thrust[:, k], column) for k, column in enumerate(floating(arm).allocation.T)]
    carried = forces_with_base(loaded(arm, 1.0), base, *joints, base_water=False)[:, :DOF] - forces
    return np.stack([*_water(arm, base), *pushed, -reaction, -carried], axis=-1)


def loaded(arm: Arm, mass: float) -> Arm:
    """The arm with ``mass`` kg more at the origin of its tool, in its last link."""
    last, (x, y, z) = arm.joints[-1], np.array(arm.tool)[:3, 3]
    body = barycentric(last.mass, last.com, last.inertia) + barycentric(mass, (x, y, z), (0.0,) * 6)
    total, com, (xx, yy, zz, xy, yz, xz) = about_com(body)
    link = replace(last, mass=total, com=com, inertia=(xx, yy, zz, xy, yz, xz))
    return replace(arm, joints=(*arm.joints[:-1], link))


def hull_wrench(arm: Arm, base: BaseRows) -> Array:
    """(N, 6) that the rigid vehicle takes without its arm, and its added mass off the diagonal, as the model has it."""
    added = floating(arm).added
    coupled = (added - np.diag(np.diag(added))).tolist()
    count = len(base.velocity)
    return _alone(arm, base, count) + stacked(recursion.added_wrench(coupled, base.motion(arm.gravity)), (count,))


def _alone(arm: Arm, base: BaseRows, count: int) -> Array:
    bare = tuple(
        replace(joint, mass=0.0, inertia=(0.0,) * 6, cylinder=None, drag=None, link_viscous=None, link_coulomb=None)
        for joint in arm.joints
    )
    still = np.zeros((count, len(arm)))
    return forces_with_base(replace(arm, joints=bare), base, still, still, still, base_water=False)[:, :DOF]


def _water(arm: Arm, base: BaseRows) -> list[Array]:
    """(N, 6) each: wrench of the water on the base per unit of its parameters, in the order of ``base_parameters``."""
    motion, count = base.motion(arm.gravity), (len(base.velocity),)
    found = []
    for k in range(DOF):
        unit = [[float(i == j == k) for j in range(DOF)] for i in range(DOF)]
        found.append(-stacked(recursion.added_wrench(unit, motion), count))
    for power in (0, 1):
        for k in range(DOF):
            column, v = np.zeros((*count, DOF)), base.velocity[:, k]
            column[:, k] = -v * np.abs(v) ** power
            found.append(column)
    down = stacked(list(motion.gravity), count)
    found.append(-np.concatenate([down, np.zeros_like(down)], axis=1))
    found += [-np.concatenate([np.zeros_like(down), np.cross(axis, down)], axis=1) for axis in np.eye(3)]
    return found
