"""Ripples that differ between the sides: orders over a joint's angle at which the torque residuals differ.

Orders, and the two ways in which a ripple may act, are those of ``identification.ripples.scan``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from comparison.joint_fit.effects import Added
from identification.preprocessing.signals import Motion
from identification.ripples import CLOSE, FINER, orders_of, wave_sums

LEAST_GAIN = 40.0
"""Squares, in those of white noise, by which a ripple that all recordings have alike must reduce them."""
WAYS = (("gear_ripple", "torque"), ("encoder_ripple", ""))
"""Effect and amplitude: a torque, and an error of an angle."""


def ripples(
    arm: Arm, motions: Sequence[Motion], residuals: Sequence[Array], after: NDArray[np.bool_], *, common: bool
) -> list[Added]:
    """The order at each joint, and of each way of acting, whose wave differs most between the sides.

    residuals  (k,) per recording, of the joint fit, over their noise
    after   (n,) True for recordings of the side after
    common  instead the torque whose wave all recordings have alike, where it stands out: a ripple that the model lacks
    """
    found = []
    for joint in range(len(arm)):
        orders = orders_of(motions, joint)
        if len(orders) < 2:
            continue
        gains = _gains(motions, residuals, joint, orders, after, common)
        for way, (effect, amplitude) in enumerate(WAYS[:1] if common else WAYS):
            best, least = float(orders[int(np.argmax(gains[:, way]))]), LEAST_GAIN if common else 0.0
            if gains[:, way].max() <= least:
                continue
            around = best + (orders[-1] - orders[0]) / (len(orders) - 1) * FINER
            finer = _gains(motions, residuals, joint, around, after, common)[:, way]
            order = _named(float(around[int(np.argmax(finer))]), arm, motions, joint)
            held = {"order": order / arm.joints[joint].ratio}
            found.append(Added(effect, joint + 1, held, amplitude, tries=len(orders)))
    return found


def _gains(
    motions: Sequence[Motion],
    residuals: Sequence[Array],
    joint: int,
    orders: Array,
    after: NDArray[np.bool_],
    common: bool,
) -> Array:
    """(o, 2) by how much a wave on one side only reduces the squares, for each way of acting; ``common``: on both.

    Of the waves of both sides z = sum e w* / S and S = sum |w|^2 / 2, it is |z_after - z_before|^2 over 1/S + 1/S, or
    |sum e w*|^2 / S of both together.
    """
    sums, power = wave_sums(motions, residuals, joint, orders, after)
    if common:
        return np.asarray(np.abs(sums.sum(axis=0)) ** 2 / power.sum(axis=0)).T
    difference = sums[1] / power[1] - sums[0] / power[0]
    return np.asarray(np.abs(difference) ** 2 / (1 / power[0] + 1 / power[1])).T


def _named(order: float, arm: Arm, motions: Sequence[Motion], joint: int) -> float:
    """The order, or whole cycles per turn of joint or motor that the travel does not distinguish from it."""
    ratio = arm.joints[joint].ratio
    turns = [ratio, 1.0] if arm.joints[joint].revolute else [ratio]
    resolution = np.pi * CLOSE / 2 / min(float(np.ptp(motion.q[:, joint])) for motion in motions)
    for turn in turns:
        whole_order = float(np.rint(order / turn)) * turn
        if whole_order > 0.0 and abs(whole_order - order) <= resolution:
            return whole_order
    return order
