"""Friction and inertial parameters of an arm from the torques of its joints, while its base floats.

    torque - (rotors, friction, links and their water, along the measured motion of base and joints) = 0

is linear in all of them (``arm_model.parameters`` has their names), so that the difference of the torque for one
parameter is its column. What the torques determine: friction and water of each joint, and of the links the combinations
that load a joint; those that only the base feels are not excited.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Arm, parameter, with_parameters
from arm_model.moving_base import forces_with_base
from arm_model.rigid_body.inertia import PARAMETERS
from identification.floating_base.columns import Rows
from identification.floating_base.rows import BaseRun

OF_JOINT = {"viscous": "N m s/rad", "coulomb": "N m", "rotor_inertia": "kg m2"}
OF_WATER = {"drag_coefficient": "1", "added_mass_coefficient": "1"}
STEP = 1e-3
"""Change of a parameter for its column; any would do, since the torque is linear in it."""


def arm_parameters(arm: Arm) -> dict[str, float]:
    """The parameters of the columns as the model has them."""
    names = []
    for number, joint in enumerate(arm.joints, 1):
        names += [f"joint{number}.{name}" for name in OF_JOINT]
        names += [f"link{number}.{name}" for name in PARAMETERS]
        names += [f"link{number}.{name}" for name in OF_WATER] if joint.cylinder is not None else []
    return {name: parameter(arm, name) for name in names}


def unit_of_arm(arm: Arm, name: str) -> str:
    """Unit of one of them."""
    head, _, quantity = name.partition(".")
    if quantity in OF_WATER:
        return OF_WATER[quantity]
    if head.startswith("link"):
        return "kg" if quantity == "mass" else "kg m" if quantity.startswith("m") else "kg m2"
    revolute = arm.joints[int(head.removeprefix("joint")) - 1].revolute
    return OF_JOINT[quantity] if revolute else {"viscous": "N s/m", "coulomb": "N", "rotor_inertia": "kg"}[quantity]


def joint_torques(arm: Arm, run: BaseRun) -> Array:
    """(m, n) N m, N at the joints, that the motion of a run takes with the friction of the drives."""
    links = forces_with_base(arm, run.base, run.q, run.qd, run.qdd)[:, 6:]
    ratio, forward = arm.joint_array("ratio"), run.qd > 0
    viscous, coulomb = (
        np.where(forward, *(np.array([getattr(joint, name)[side] for joint in arm.joints]) for side in (0, 1)))
        for name in ("viscous", "coulomb")
    )
    sign = run.qd / np.sqrt(run.qd**2 + np.array([joint.sign_velocity for joint in arm.joints]) ** 2)
    drives = ratio**2 * (arm.joint_array("rotor_inertia") * run.qdd + viscous * run.qd) + ratio * coulomb * sign
    return np.asarray(links + drives)


def joint_rows(arm: Arm, runs: Sequence[BaseRun]) -> Rows:
    """Compared rows of all runs: (k, n) torques, and their columns (k, n, p)."""
    values, columns, known, block, first = arm_parameters(arm), [], [], [], 0
    changed = [with_parameters(arm, {name: value + STEP}) for name, value in values.items()]
    for run in runs:
        torques = joint_torques(arm, run)
        slopes = np.stack([(joint_torques(other, run) - torques) / STEP for other in changed], axis=-1)
        columns.append(run.compared(slopes))
        # what no parameter is: zero, unless the arm has more than the columns
        residual = torques - slopes @ np.array(list(values.values()))
        known.append(run.compared(run.torque - residual))
        block.append(run.block + first)
        first += int(run.block[-1]) + 1
    none = np.zeros((len(arm), 0))
    return Rows(
        names=tuple(values),
        columns=np.concatenate(columns),
        known=np.concatenate(known),
        block=np.concatenate(block),
        t=np.concatenate([run.t for run in runs]),
        run=np.repeat(np.arange(len(runs)), [len(part) for part in known]),
        allocation=none,
        demand=np.zeros((sum(map(len, known)), 0)),
    )
