"""A joint's friction curve as the departure from a straight line, which is its Coulomb and viscous friction.

The same friction can be split into line and curve in many ways. Here the line is that nearest to all friction over the
speeds of the curve in the power lost, so that ``coulomb`` and ``viscous`` keep the meaning that they have without one:
level and slope.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model.description import Arm, Joint
from arm_model.parameters import curve_place, friction_and_direction, unchecked
from arm_model.rigid_body.friction_curve import line_through, total_at, weights
from arm_model.tables.drive import FrictionCurve


@lru_cache(maxsize=256)
def departures(speed: tuple[float, ...]) -> tuple[Array, NDArray[np.intp]]:
    """(K, K - 2) and (K - 2,): a curve whose nearest line is zero, from its values at K - 2 of its speeds.

    The second: which speeds (from 0) these are. Two values follow from the others: whatever a line could say is the
    joint's Coulomb and viscous friction, and a curve is by how much friction departs from it.
    """
    v = np.asarray(speed, float)
    moments = np.stack([np.ones_like(v), v]) * weights(v)
    sizes = np.abs(moments[0][:, None] * moments[1] - moments[1][:, None] * moments[0])
    follow = np.array(np.unravel_index(int(np.argmax(sizes)), sizes.shape))
    kept = np.setdiff1d(np.arange(len(v)), follow)
    basis = np.zeros((len(v), len(kept)))
    basis[kept] = np.eye(len(kept))
    basis[follow] = -np.linalg.solve(moments[:, follow], moments[:, kept])
    return basis, kept


def follows(joint: Joint, name: str) -> bool:
    """Whether a value of the joint's curve ('curve3', 'curve3_positive') follows from the others."""
    place = curve_place(joint, friction_and_direction(name)[0])
    return joint.friction_curve is not None and place not in departures(joint.friction_curve.speed)[1]


def unit_departure(joint: Joint, name: str, v: Array) -> Array | None:
    """(k,) at speeds v (k,) >= 0 of a unit of one value ('curve3') of a curve, with those that follow from it.

    None for a name that is no such value.
    """
    place = curve_place(joint, name)
    if place is None or joint.friction_curve is None:
        return None
    basis, kept = departures(joint.friction_curve.speed)
    column = np.flatnonzero(kept == place)
    return np.interp(v, joint.friction_curve.speed, basis[:, column[0]]) if len(column) else None


def split(joint: Joint) -> Joint:
    """The joint with the same friction, its curve the departure from the nearest line of each direction.

    That line becomes its Coulomb and viscous friction. Beyond the last speed of the curve friction continues along it.
    """
    curve = joint.friction_curve
    if curve is None:
        return joint
    speed = np.array(curve.speed)
    lines = [line_through(speed) @ total for total in total_at(joint, speed)]
    rest = [total - level - slope * speed for total, (level, slope) in zip(total_at(joint, speed), lines)]
    return unchecked(
        joint,
        coulomb=tuple(float(level) / joint.ratio for level, _ in lines),
        viscous=tuple(float(slope) / joint.ratio**2 for _, slope in lines),
        friction_curve=FrictionCurve(curve.speed, *(tuple(each.tolist()) for each in rest)),
    )


def completed(joint: Joint) -> Joint:
    """The joint with those values of its curve that follow from the others (``departures``) made to follow."""
    curve = joint.friction_curve
    if curve is None:
        return joint
    basis, kept = departures(curve.speed)
    sides = (tuple((basis @ np.array(values)[kept]).tolist()) for values in (curve.positive, curve.negative))
    return unchecked(joint, friction_curve=FrictionCurve(curve.speed, *sides))


def split_arm(arm: Arm) -> Arm:
    """The arm with the friction of every joint ``split``."""
    return replace(arm, joints=tuple(map(split, arm.joints)))


def straightened(arm: Arm) -> Arm:
    """The arm without friction curves: of each the nearest line."""
    return replace(arm, joints=tuple(unchecked(split(joint), friction_curve=None) for joint in arm.joints))
