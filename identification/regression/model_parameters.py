"""Parameters of an arm that a regression identifies: their names, their columns and the model's own values.

Those of links and drives, friction as requested, then those of the effects (``effect_columns``).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from arm_io.types import Array
from arm_model import Arm, parameter
from arm_model.effects import coupled
from arm_model.friction_split import departures, follows
from arm_model.rigid_body import jacobian
from arm_model.rigid_body.regressor import parameter_names, parameter_vector, regressor
from identification.regression.effect_columns import Samples, effect_columns, effect_parameters, shown_torque

Friction = Literal["symmetric", "asymmetric"]
LEVEL = 1e-6
"""Sine of the slope below which a sliding joint counts as level."""


def column_names(arm: Arm, friction: Friction) -> list[str]:
    """Names of ``model_columns``: regressor, friction as requested, rotors where the model has one or a gear, effects.

    symmetric   viscous, coulomb, offset: with a constant offset, Coulomb friction may differ by direction
    asymmetric  viscous_positive, viscous_negative, coulomb_positive, coulomb_negative; an offset could not be
                identified separately from these
    Of a friction curve those values from which the others follow (``arm_model.friction_split``).
    """
    described = [name for name in parameter_names(arm, friction=friction) if not _left_out(arm, name, friction)]
    return described + effect_parameters(arm)


def model_columns(
    arm: Arm, q: Array, qd: Array, qdd: Array, friction: Friction = "symmetric", t: Array | None = None
) -> Array:
    """(N, n, p) regressor with the columns ``column_names(arm, friction)``.

    t (N,) s is needed by effects that change in time.
    """
    described = described_columns(arm, q, qd, qdd, friction)
    if not arm.effects:
        return described
    motion = Samples(q, qd, qdd, np.zeros(len(q)) if t is None else t)
    columns = effect_columns(arm, arm, motion, shown_torque(arm, arm, motion))
    return np.concatenate([described, columns], axis=2)


def described_columns(arm: Arm, q: Array, qd: Array, qdd: Array, friction: Friction) -> Array:
    """(N, n, p - e) columns of links and drives, including couplings of drives by effects of the arm.

    All other effects move links and drives alike, so a Gauss-Newton step needs nothing of them here.

    With symmetric friction, the offset of a joint whose Coulomb friction the model has by direction is half of that
    difference, and goes through zero with the velocity: sign^2 instead of 1. Not so where the offset is also a weight
    (``lifts``): there the difference is a constant, with either friction.
    """
    full, names = regressor(coupled(arm), q, qd, qdd, friction=friction)
    for j, joint in enumerate(arm.joints):
        if friction == "asymmetric" and lifts(arm, j):
            forwards, backwards = (names.index(f"joint{j + 1}.coulomb_{way}") for way in ("positive", "negative"))
            sign = full[:, j, forwards] + full[:, j, backwards]
            full[:, j, forwards], full[:, j, backwards] = (sign + 1.0) / 2.0, (sign - 1.0) / 2.0
        elif friction == "symmetric" and joint.coulomb[0] != joint.coulomb[1] and not lifts(arm, j):
            sign = full[:, j, names.index(f"joint{j + 1}.coulomb")]
            full[:, j, names.index(f"joint{j + 1}.offset")] = sign**2
    for j, joint in enumerate(arm.joints):
        if joint.friction_curve is not None:
            basis, kept = departures(joint.friction_curve.speed)
            ends = ("_positive", "_negative") if friction == "asymmetric" else ("",)
            for points in (curve_names(j, len(basis), end) for end in ends):
                at_points = np.array([names.index(point) for point in points])
                full[:, j, at_points[kept]] = full[:, j, at_points] @ basis
    return full[:, :, [k for k, name in enumerate(names) if not _left_out(arm, name, friction)]]


def lifts(arm: Arm, j: int) -> bool:
    """Whether joint j (from 0) slides and bears weight: a constant force, indistinguishable from an offset."""
    if arm.joints[j].revolute:
        return False
    axis = jacobian(arm, np.zeros(len(arm)))[:3, j]
    return bool(abs(axis @ arm.gravity) > LEVEL * np.linalg.norm(arm.gravity))


def lifted_masses(arm: Arm) -> list[float]:
    """(n,) kg that each joint lifts; 0 where it turns or slides on the level."""
    masses = arm.joint_array("mass")
    return [float(masses[j:].sum()) if lifts(arm, j) else 0.0 for j in range(len(arm))]


def curve_names(j: int, count: int, direction: str) -> list[str]:
    """Names of the values of the friction curve of joint j (from 0), for "_positive", "_negative" or both, ""."""
    return [f"joint{j + 1}.curve{k}{direction}" for k in range(1, count + 1)]


def model_values(arm: Arm, friction: Friction = "symmetric") -> Array:
    """(p,) the arm's own values of the parameters ``column_names(arm, friction)``.

    While a joint moves, a constant torque cannot be distinguished from a difference of the two Coulomb magnitudes: with
    symmetric friction the offset carries half of that difference, with asymmetric friction the magnitudes carry the
    offset.
    """
    values = []
    for name, value in zip(parameter_names(arm, friction=friction), parameter_vector(arm, friction=friction)):
        if _left_out(arm, name, friction):
            continue
        head, _, quantity = name.partition(".")
        joint = arm.joints[int(head.removeprefix("joint")) - 1] if head.startswith("joint") else None
        if joint is not None and quantity == "offset":
            value += joint.ratio * (joint.coulomb[0] - joint.coulomb[1]) / 2
        elif joint is not None and quantity in ("coulomb_positive", "coulomb_negative"):
            value += joint.ratio * joint.offset * (1 if quantity.endswith("positive") else -1)
        values.append(value)
    return np.array(values + [parameter(arm, name) for name in effect_parameters(arm)])


def _left_out(arm: Arm, name: str, friction: Friction) -> bool:
    head, _, quantity = name.partition(".")
    if quantity == "offset":
        return friction == "asymmetric"
    if quantity.startswith("curve"):
        return follows(arm.joints[int(head.removeprefix("joint")) - 1], quantity)
    if quantity != "rotor_inertia":
        return False
    return not _has_rotor(arm, int(head.removeprefix("joint")) - 1)


def _has_rotor(arm: Arm, j: int) -> bool:
    """Whether the rotor inertia of joint j (from 0) is a parameter of its own.

    Without rotor and gear in the model it is part of what the joint moves: behind a gear it turns as fast as the motor,
    and no link's inertia is felt as it is. A joint that lifts is driven by a screw or a belt whatever the model says,
    and a rotor counted as mass would have a weight, which only an offset could take away.
    """
    joint = arm.joints[j]
    return joint.rotor_inertia != 0.0 or joint.ratio != 1.0 or lifts(arm, j)


def freed_rotors(arm: Arm) -> list[int]:
    """Joints (from 1) whose model has no rotor inertia although they have a gear or lift: it is identified."""
    return [j + 1 for j, joint in enumerate(arm.joints) if joint.rotor_inertia == 0.0 and _has_rotor(arm, j)]


def without_rotors(arm: Arm) -> str:
    """A sentence on a model that has neither rotors nor gears, which would free them; "" where it has, or one joint."""
    if any(joint.rotor_inertia or joint.ratio != 1.0 for joint in arm.joints[1:]) or len(arm) == 1:
        return ""
    return (
        "The model has no rotors, so that their inertia counts as inertia of the links. With a gear in the model "
        "(gear = 100 and torque_constant = 0.01, if torques at the joints are recorded) rotors are identified."
    )
