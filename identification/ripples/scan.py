"""Orders over a joint's angle at which what a regression leaves of its torques repeats.

A wave repeats with the angle of a joint, of its motor, or of a shaft between. Orders are searched as closely as the
travel of the joint resolves them, as far as the motion's band shows them; two ways of acting: a torque of constant
amplitude, and an error of an angle, which acts by the acceleration that it makes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, parallel_filter

WIDE = 20.0
"""Hz: band in which ripples are looked for."""
WITHIN = 0.7
"""Share of the band in which the motion is known that this band does not exceed."""
APART = 1.2
"""Samples per second of that band, over the least whose folding its low-pass removes."""
LEAST_CYCLES = 1.5
"""Cycles within the travel of a joint: less of a wave is a smooth function of its angle."""
CLOSE = 0.5
"""Distance of the orders that are tried, in cycles within the travel."""
MOST_ORDERS = 400
"""Per joint; beyond it a wave is faster than the band of any motion that covers so many."""
SLOW = 0.5
"""Quantile of a joint's speed while it moves at which a wave must be within the band."""
TOGETHER = 50
"""Orders whose waves are in memory at a time."""


def wide(motion: Motion) -> Motion:
    """The motion with rows in the band of ripples, which friction and bodies do not need.

    Of samples that are many times as fast as its band, every so many: the low-pass of the rows removes what folds.
    """
    parallel = max(motion.band.parallel, min(WIDE, WITHIN * motion.band.motion))
    step = max(1, int(1.0 / (APART * (motion.band.motion + parallel) * motion.dt)))
    names = ("t", "q", "qd", "qdd", "torque", "usable", "certain")
    thinned = {name: getattr(motion, name)[::step] for name in names}
    band = replace(motion.band, parallel=parallel)
    return replace(motion, dt=step * motion.dt, band=band, folded=None, **thinned)


def orders_of(motions: Sequence[Motion], joint: int) -> Array:
    """(o,) rad of a wave per rad (m) of a joint (from 0), evenly apart: from a few cycles in its travel to the band."""
    moving = [np.abs(motion.qd[motion.certain[:, joint], joint]) for motion in motions]
    if not all(len(one) for one in moving):
        return np.empty(0)
    travel = min(float(np.ptp(motion.q[:, joint])) for motion in motions)
    slow = min(float(np.quantile(one, SLOW)) for one in moving)
    fastest = min(motion.band.parallel for motion in motions) / max(slow, 1e-9)
    step = CLOSE / travel
    cycles = np.arange(LEAST_CYCLES / travel, fastest, step)[:MOST_ORDERS]
    return np.asarray(2 * np.pi * cycles)


def wave_sums(
    motions: Sequence[Motion], residuals: Sequence[Array], joint: int, orders: Array, late: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """(2, 2, o) sum e w* of residuals e and waves w, and (2, 2, o) sum |w|^2 / 2: of both sides, both ways of acting.

    The wave that fits a side is their ratio, and reduces its squares by |sum e w*|^2 / (sum |w|^2 / 2).

    residuals  (k,) per motion, of its rows (``equation_rows``), over their noise
    orders     (o,) evenly apart
    late       (n,) True for motions of the second side
    Ways: a torque, and an error of an angle, in proportion to the square of the speed.
    """
    sums, power = np.zeros((2, 2, len(orders)), complex), np.zeros((2, 2, len(orders)))
    for motion, residual, side in zip(motions, residuals, late.astype(int)):
        joints, row = np.nonzero(equation_rows(motion)[1].T)
        of_joint = joints == joint
        weight = equation_weight(motion)[:, joint, None]
        of_speed = motion.qd[:, joint, None] ** 2
        for first in range(0, len(orders), TOGETHER):
            some = slice(first, first + TOGETHER)
            waves = _waves(motion.q[:, joint], orders[some], orders[1] - orders[0]) * weight
            for way, size in enumerate([np.ones_like(of_speed), of_speed]):
                cos, sin = np.split(parallel_filter(motion, waves * size)[row[of_joint]], 2, axis=1)
                sums[side, way, some] += residual[of_joint] @ cos - 1j * (residual[of_joint] @ sin)
                power[side, way, some] += (np.sum(cos**2, axis=0) + np.sum(sin**2, axis=0)) / 2
    return sums, np.maximum(power, 1e-9 * power.max())


def _waves(q: Array, orders: Array, apart: float) -> Array:
    """(m, 2 o) cosine and sine of ``orders`` (o,) so far ``apart``, over angles (m,)."""
    first, step = (np.exp(1j * order * q)[:, None] for order in (orders[0], apart))
    turns = np.cumprod(np.concatenate([first, np.repeat(step, len(orders) - 1, axis=1)], axis=1), axis=1)
    return np.concatenate([turns.real, turns.imag], axis=1)
