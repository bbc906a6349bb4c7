"""Ripples that differ between the sides: orders over a joint's angle at which what is left of their torques differs.

A wave repeats with the angle of a joint, of its motor, or of a shaft between. Orders are searched as closely as the
travel of the joint resolves them, as far as the motion's band shows them; two ways of acting: a torque of constant
amplitude, and an error of an angle, which acts by the acceleration that it makes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from comparison.joint_fit.effects import Added
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, parallel_filter

LEAST_CYCLES = 1.5
"""Cycles within the travel of a joint: less of a wave is a smooth function of its angle."""
CLOSE = 0.5
"""Distance of the orders that are tried, in cycles within the travel."""
LEAST_GAIN = 40.0
"""Squares, in those of white noise, by which a ripple that all recordings have alike must reduce them."""
FINER = np.linspace(-1.0, 1.0, 17)
"""Orders about the best, in distances of those that are tried."""
MOST_ORDERS = 400
"""Per joint; beyond it a wave is faster than the band of any motion that covers so many."""
SLOW = 0.5
"""Quantile of a joint's speed while it moves at which a wave must be within the band."""
WAYS = (("gear_ripple", "torque"), ("encoder_ripple", ""))
"""Effect and amplitude: a torque, and an error of an angle."""


def ripples(
    arm: Arm, motions: Sequence[Motion], left: Sequence[Array], after: NDArray[np.bool_], *, common: bool
) -> list[Added]:
    """The order at each joint, and of each way of acting, whose wave differs most between the sides.

    left    (k,) per recording, what the joint fit leaves of its rows, over their noise
    after   (n,) True for recordings of the side after
    common  instead the torque whose wave all recordings have alike, where it stands out: a ripple that the model lacks
    """
    found = []
    for joint in range(len(arm)):
        orders = _orders(motions, joint)
        if len(orders) < 2:
            continue
        gains = _gains(motions, left, joint, orders, after, common)
        for way, (effect, amplitude) in enumerate(WAYS[:1] if common else WAYS):
            best, least = float(orders[int(np.argmax(gains[:, way]))]), LEAST_GAIN if common else 0.0
            if gains[:, way].max() <= least:
                continue
            around = best + (orders[-1] - orders[0]) / (len(orders) - 1) * FINER
            finer = _gains(motions, left, joint, around, after, common)[:, way]
            order = _named(float(around[int(np.argmax(finer))]), arm, motions, joint)
            held = {"order": order / arm.joints[joint].ratio}
            found.append(Added(effect, joint + 1, held, amplitude, tries=len(orders)))
    return found


def _orders(motions: Sequence[Motion], joint: int) -> Array:
    """(o,) cycles per rad (m) of a joint, times 2 pi: from a few in its travel to the end of the band."""
    moving = [np.abs(motion.qd[motion.certain[:, joint], joint]) for motion in motions]
    if not all(len(one) for one in moving):
        return np.empty(0)
    travel = min(float(np.ptp(motion.q[:, joint])) for motion in motions)
    slow = min(float(np.quantile(one, SLOW)) for one in moving)
    fastest = min(motion.band.parallel for motion in motions) / max(slow, 1e-9)
    apart = CLOSE / travel
    cycles = np.arange(LEAST_CYCLES / travel, fastest, apart)[:MOST_ORDERS]
    return np.asarray(2 * np.pi * cycles)


def _gains(
    motions: Sequence[Motion],
    left: Sequence[Array],
    joint: int,
    orders: Array,
    after: NDArray[np.bool_],
    common: bool,
) -> Array:
    """(o, 2) by how much a wave on one side only reduces the squares, for each way of acting; ``common``: on both.

    Of the waves of both sides z = sum e w* / S and S = sum |w|^2 / 2, it is |z_after - z_before|^2 over 1/S + 1/S, or
    |sum e w*|^2 / S of both together.
    """
    sums = np.zeros((2, 2, len(orders)), complex)
    power = np.zeros((2, 2, len(orders)))
    for motion, residual, late in zip(motions, left, after.astype(int)):
        trusted = equation_rows(motion)[1]
        of_joint, row = np.nonzero(trusted.T)
        mine = of_joint == joint
        weight = equation_weight(motion)[:, joint, None]
        waves = _waves(motion.q[:, joint], orders) * weight
        of_speed = motion.qd[:, joint, None] ** 2
        for way, size in enumerate([np.ones_like(of_speed)] if common else [np.ones_like(of_speed), of_speed]):
            seen = parallel_filter(motion, waves * size)[row[mine]]
            cos, sin = seen[:, : len(orders)], seen[:, len(orders) :]
            sums[late, way] += residual[mine] @ cos - 1j * (residual[mine] @ sin)
            power[late, way] += (np.sum(cos**2, axis=0) + np.sum(sin**2, axis=0)) / 2
    power = np.maximum(power, 1e-9 * power.max())
    if common:
        return np.asarray(np.abs(sums.sum(axis=0)) ** 2 / power.sum(axis=0)).T
    difference = sums[1] / power[1] - sums[0] / power[0]
    return np.asarray(np.abs(difference) ** 2 / (1 / power[0] + 1 / power[1])).T


def _waves(q: Array, orders: Array) -> Array:
    """(m, 2 o) cosine and sine of ``orders`` (o,) equally far apart, over angles (m,)."""
    apart = (orders[-1] - orders[0]) / (len(orders) - 1)
    first, step = (np.exp(1j * order * q)[:, None] for order in (orders[0], apart))
    turns = np.cumprod(np.concatenate([first, np.repeat(step, len(orders) - 1, axis=1)], axis=1), axis=1)
    return np.concatenate([turns.real, turns.imag], axis=1)


def _named(order: float, arm: Arm, motions: Sequence[Motion], joint: int) -> float:
    """The order, or whole cycles per turn of joint or motor that the travel does not distinguish from it."""
    ratio = arm.joints[joint].ratio
    turns = [ratio, 1.0] if arm.joints[joint].revolute else [ratio]
    apart = np.pi * CLOSE / 2 / min(float(np.ptp(motion.q[:, joint])) for motion in motions)
    for turn in turns:
        whole = float(np.rint(order / turn)) * turn
        if whole > 0.0 and abs(whole - order) <= apart:
            return whole
    return order
