"""Friction of free shape: a curve through given values at given speeds of a joint, for each direction of motion.

Between the speeds it is a straight line, below the first and beyond the last it is constant: a linear spline, linear in
its values. As a sum that runs on numbers, arrays, tape expressions and symbols alike, with b_k by how much the slope
changes at the speed s_k (0 before the first, 0 after the last):

    c(v) = P_0 + sum_k b+_k max(v - s_k, 0)    for v > 0,    N_0 + sum_k b-_k max(-v - s_k, 0)    for v < 0

It adds to Coulomb's friction of the same direction: the torque is c(v) times the smooth sign of v
(``arm_model.rigid_body.numeric.drive_torque``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.description import Joint
from arm_model.rigid_body import scalar
from arm_model.tables.drive import FrictionCurve


def bends(speed: Sequence[float], values: Array) -> Array:
    """(..., K) N m s/rad (N s/m): change of the slope at each speed, of a curve through ``values`` (..., K)."""
    slope = np.diff(values, axis=-1) / np.diff(speed)
    nothing = np.zeros((*np.shape(values)[:-1], 1))
    return np.diff(slope, axis=-1, prepend=nothing, append=nothing)


def beyond(v: Any, speed: Sequence[Any], positive: Sequence[Any], negative: Sequence[Any]) -> Any:
    """N m (N): what the curve at speed v, a scalar of any kind, has above its value at rest in the same direction.

    positive, negative (K,): ``bends`` of the two directions.
    """
    total: Any = 0.0
    for s, up, down in zip(speed, positive, negative):
        total = total + up * scalar.maximum(v - s, 0.0) + down * scalar.maximum(-v - s, 0.0)
    return total


def curve_at(curve: FrictionCurve, v: Array, direction: int) -> Array:
    """(k,) N m (N) at speeds v (k,) >= 0 in a direction (1 or -1)."""
    return np.interp(v, curve.speed, curve.positive if direction > 0 else curve.negative)


def curve_level(curve: FrictionCurve, v: Any, sign: Any) -> Any:
    """N m (N) of the curve at speed v in its direction, whose smooth sign is ``sign``; scalars of any kind."""
    up, down = (bends(curve.speed, np.array(values)).tolist() for values in (curve.positive, curve.negative))
    first = (curve.positive[0] + curve.negative[0]) / 2, (curve.positive[0] - curve.negative[0]) / 2
    return first[0] + first[1] * sign + beyond(v, curve.speed, up, down)


def unit_torques(speed: Sequence[float], v: Array, sign: Array) -> tuple[Array, Array]:
    """(N, K) twice: torque of a unit of each of a curve's values, of the positive and of the negative direction.

    v, sign (N,): the speed and its smooth sign. Multiplied by the values and added they are ``curve_level`` times sign.
    """
    hats = np.stack([np.interp(np.abs(v), speed, unit) for unit in np.eye(len(speed))], axis=-1)
    torques = []
    for way in (1.0, -1.0):
        one_way = hats * (way * v > 0)[:, None]
        # what is there at rest turns about with both signs, as Coulomb's friction does
        one_way[:, 0] += (1.0 + way * sign) / 2 - (way * v > 0)
        torques.append(one_way * sign[:, None])
    return torques[0], torques[1]


def nearest_line(joint: Joint) -> tuple[float, float, float]:
    """Coulomb N m (N) and viscous N m s/rad (N s/m) friction at the joint nearest to all of a joint's friction.

    Neither is negative, as files of other programs have it: of a line that would be, the other coefficient alone.
    That of its own axis (``link_viscous``, ``link_coulomb``) included. The third: by how much the line is off at most,
    N m (N), at the speeds of its curve; both directions are taken together.
    """
    level, slope = joint.ratio * sum(joint.coulomb) / 2, joint.ratio**2 * sum(joint.viscous) / 2
    curve = joint.friction_curve
    speed = np.array([0.0, 1.0] if curve is None else curve.speed)
    total = total_at(joint, speed)
    if curve is not None:
        mean = (total[0] + total[1]) / 2
        level, slope = line_through(speed) @ mean
        if level < 0.0:
            level, slope = 0.0, np.sum(weights(speed) * speed * mean) / np.sum(weights(speed) * speed**2)
        elif slope < 0.0:
            level, slope = np.sum(weights(speed) * mean) / np.sum(weights(speed)), 0.0
    off = float(max(np.abs(each - level - slope * speed).max() for each in total))
    return float(level) + (joint.link_coulomb or 0.0), float(slope) + (joint.link_viscous or 0.0), off


def total_at(joint: Joint, speed: Array) -> tuple[Array, Array]:
    """(K,) twice N m (N): Coulomb, viscous friction and curve of a joint at speeds (K,) >= 0, positive and negative."""
    total = [joint.ratio * c + joint.ratio**2 * b * speed for c, b in zip(joint.coulomb, joint.viscous)]
    if joint.friction_curve is not None:
        total = [straight + curve_at(joint.friction_curve, speed, way) for straight, way in zip(total, (1, -1))]
    return total[0], total[1]


def line_through(speed: Sequence[float] | Array) -> Array:
    """(2, K) that maps values at K speeds to level and slope of the line nearest to the curve through them.

    Least squares of the power lost, torque times speed: a speed counts by its square, and by the range that it stands
    for (the trapezoid rule). What friction does near rest, where a curve makes up for how abruptly the model's friction
    turns, does not tilt the line, along which friction continues beyond the last speed.
    """
    v = np.asarray(speed, float)
    root = np.sqrt(weights(v))
    return np.asarray(np.linalg.pinv(np.stack([np.ones_like(v), v], axis=1) * root[:, None]) * root)


def weights(v: Array) -> Array:
    """(K,) of K increasing speeds in the power lost: the square of each, times the range that it stands for."""
    step = np.diff(v)
    return np.asarray(v**2 * (np.append(step, 0.0) + np.append(0.0, step)) / 2)
