"""Friction of free shape: the torque that opposes motion, at a few speeds of each joint and direction.

Between the speeds the curve is a straight line. Nothing else is assumed: not Coulomb's law, no viscous part, no hump.
The same speeds are used for all recordings of a comparison, so that a curve means the same in each; where one recording
alone is slower or faster, it gets a point of its own there, which is fitted and not compared. So does each where
friction turns with the direction of motion: how it does is no part of its level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import curve_at
from identification.preprocessing.signals import Motion, stretches_of

SHARES = (0.0, 0.12, 0.3, 0.6, 1.0)
"""Places of the compared speeds within the common range, as shares of the time spent in it."""
SPAN = 2.0
"""Fastest common speed over the slowest, at least, for a curve; below it friction is compared at one speed."""
SLOWER = 1.3
"""A recording that is slower than the common range by this factor gets a point of its own there."""
FASTER = 1.02
"""A recording that is faster than the common range by this factor gets one there."""
TAIL = 0.02
"""Share of the time of a direction that is left out at the lower end of its range."""
EXCURSIONS = 2
"""Separate movements in a direction that reach the fastest compared speed, at least.

The error of a point that a single movement determines shows in no residual: the point absorbs it.
"""
ENOUGH = 2
"""Recordings of a side that must show friction of a joint and direction; all of a smaller side."""
TURNS, MOSTLY = 3.0, 0.3
"""Speed below which friction turns, over the ``sign_velocity`` of the model (there, its smooth sign lacks 5 %); and
over the peak speed of the joint at most, which leaves most of a slow motion."""
FEWEST = 200
"""Samples of a direction; fewer say nothing about friction."""


@dataclass(frozen=True)
class Curve:
    """The compared points of one joint (from 0) and direction (1.0 or -1.0): speeds (K,) rad/s (m/s), increasing.

    why: the reason where there are none.
    """

    joint: int
    direction: float
    speeds: Array
    why: str = ""


def speeds_of(motion: Motion, joint: int, direction: float) -> Array:
    """(k,) |velocity| of a joint (from 0) on samples at which it surely moves in ``direction``."""
    velocity = direction * motion.qd[:, joint]
    return np.asarray(velocity[motion.certain[:, joint] & (velocity > 0)])


def peak_speed(motion: Motion, joint: int, direction: float) -> float:
    """The speed that a joint (from 0) reaches in EXCURSIONS separate movements in a direction; 0 with fewer."""
    velocity = direction * motion.qd[:, joint] * motion.certain[:, joint]
    # uncertain rows interrupt a movement too, so peaks must be some distance apart
    separation = int(0.1 / motion.dt)
    peaks = sorted(
        float(velocity[start:stop].max()) for start, stop in stretches_of(velocity > 0) if stop - start > separation
    )
    return peaks[-EXCURSIONS] if len(peaks) >= EXCURSIONS else 0.0


def shows(motion: Motion, joint: int, direction: float) -> bool:
    """Whether a motion shows friction of a joint (from 0) in a direction."""
    enough = len(speeds_of(motion, joint, direction)) >= FEWEST
    return enough and peak_speed(motion, joint, direction) > 0.0


def common_curves(
    motions: Sequence[Motion], names: Sequence[str], arm: Arm, is_before: NDArray[np.bool_]
) -> list[Curve]:
    """For each joint and direction the speeds at which the ``motions`` show friction.

    names  of the recordings
    is_before (n,) True for recordings of the side before: of each side, ENOUGH of them must show it; None: all must
    """
    places = [(joint, direction) for joint in range(len(arm)) for direction in (1.0, -1.0)]
    return [_curve(motions, names, arm, place, is_before) for place in places]


def _curve(
    motions: Sequence[Motion],
    names: Sequence[str],
    arm: Arm,
    place: tuple[int, float],
    is_before: NDArray[np.bool_] | None,
) -> Curve:
    joint, direction = place
    nothing = np.empty(0)
    shown = np.array([shows(motion, joint, direction) for motion in motions])
    groups = [shown] if is_before is None else [shown[is_before], shown[~is_before]]
    if any(of_side.sum() < (len(of_side) if is_before is None else min(len(of_side), ENOUGH)) for of_side in groups):
        missing = int(np.argmin(shown))
        return Curve(joint, direction, nothing, _why(motions[missing], names[missing], joint, direction))
    motions = [motion for motion, well in zip(motions, shown) if well]
    speeds = [speeds_of(motion, joint, direction) for motion in motions]
    peaks = [peak_speed(motion, joint, direction) for motion in motions]
    turns = TURNS * arm.joints[joint].sign_velocity
    slowest = [max(float(np.quantile(mine, TAIL)), min(turns, MOSTLY * peak)) for mine, peak in zip(speeds, peaks)]
    ends = list(zip(slowest, peaks))
    sides = [np.ones(len(motions), bool)] if is_before is None else [is_before[shown], ~is_before[shown]]
    low, high = _shared([[end for end, mine in zip(ends, side) if mine] for side in sides], is_before is None)
    if low >= high:
        unit = "rad/s" if arm.joints[joint].revolute else "m/s"
        slow, fast = (min(ends, key=lambda end: end[1]), max(ends, key=lambda end: end[0]))
        ranges = f"at most {slow[1]:.2g}, at least {fast[0]:.2g} {unit}"
        return Curve(joint, direction, nothing, f"joint {joint + 1} moves at different speeds ({ranges})")
    if high < SPAN * low:
        return Curve(joint, direction, np.array([np.sqrt(low * high)]))
    inside = np.concatenate([mine[(mine >= low) & (mine <= high)] for mine in speeds])
    placed = np.unique(np.quantile(inside, SHARES))
    placed[0], placed[-1] = low, high
    # Speeds closer than a tenth of the range would share their samples.
    kept = [low, *(v for v in placed[1:-1] if v - low > 0.04 * (high - low) and high - v > 0.1 * (high - low)), high]
    return Curve(joint, direction, np.array(kept))


def _shared(sides: Sequence[Sequence[tuple[float, float]]], by_all: bool) -> tuple[float, float]:
    """From the lowest to the highest speed that ENOUGH recordings of each side reach, of (lowest, highest) of each.

    by_all: that all of them reach.
    """
    last = [len(ends) if by_all else min(len(ends), ENOUGH) for ends in sides]
    low = max(sorted(end[0] for end in ends)[place - 1] for ends, place in zip(sides, last))
    high = min(sorted((end[1] for end in ends), reverse=True)[place - 1] for ends, place in zip(sides, last))
    return low, high


def _why(motion: Motion, name: str, joint: int, direction: float) -> str:
    """The reason why a recording does not show friction of a joint (from 0) in a direction."""
    moved = speeds_of(motion, joint, direction).any()
    how = f"moves joint {joint + 1} fewer than {EXCURSIONS} times" if moved else f"never moves joint {joint + 1}"
    return f"{name} {how} in {'positive' if direction > 0 else 'negative'} direction"


def knots_of(curve: Curve, motion: Motion) -> tuple[Array, NDArray[np.intp]]:
    """(L,) speeds of one recording's curve, and the place (L,) of each among those that are compared.

    -1: its own, beyond the common range, or where it is slower than that ends; where nothing is compared, or the
    recording does not show friction there well enough, all are.
    """
    mine = speeds_of(motion, curve.joint, curve.direction)
    peak = peak_speed(motion, curve.joint, curve.direction) if shows(motion, curve.joint, curve.direction) else 0.0
    reached = np.flatnonzero(curve.speeds <= peak * FASTER)
    if not len(reached):
        if len(mine) < 2:
            return np.empty(0), np.empty(0, np.intp)
        own = np.unique(np.quantile(mine, (TAIL, 0.3, 1.0)))
        return own, np.full(len(own), -1)
    low, high = float(np.quantile(mine, TAIL)), float(mine.max())
    slower = [low] if low * SLOWER < curve.speeds[0] else []
    faster = [high] if high > FASTER * curve.speeds[reached[-1]] else []
    place = np.concatenate([np.full(len(slower), -1), reached, np.full(len(faster), -1)])
    return np.array([*slower, *curve.speeds[reached], *faster]), place


def hats(motion: Motion, curve: Curve, knots: Array) -> Array:
    """(m, L) torque of the joint per unit friction at each of its ``knots`` (L,); nothing in the other direction."""
    velocity = curve.direction * motion.qd[:, curve.joint]
    moving = np.maximum(velocity, 0.0)
    shares = [np.interp(moving, knots, unit) for unit in np.eye(len(knots))]
    return curve.direction * np.stack(shares, axis=1) * (velocity > 0)[:, None]


def model_friction(arm: Arm, curve: Curve, speeds: Array) -> Array:
    """(K,) what the model has at these speeds, N m (N): the value of a point that a recording does not show."""
    joint, place = arm.joints[curve.joint], 0 if curve.direction > 0 else 1
    own = joint.friction_curve
    return np.asarray(
        joint.ratio**2 * joint.viscous[place] * speeds
        + joint.ratio * (joint.coulomb[place] + curve.direction * joint.offset)
        + (0.0 if own is None else curve_at(own, speeds, 1 if curve.direction > 0 else -1))
    )


def level_and_slope(speeds: Array, weight: Array) -> Array:
    """(2, K) that maps a curve to its level at zero speed and its slope, by least squares with ``weight`` (K,).

    (1, K), the level alone, of a single point. The map is the same on both sides of a comparison: friction of another
    shape than a straight line gives another level, but the same on both.
    """
    if len(speeds) == 1:
        return np.ones((1, 1))
    columns = np.stack([np.ones_like(speeds), speeds], axis=1) * np.sqrt(weight)[:, None]
    return np.asarray(np.linalg.pinv(columns) * np.sqrt(weight))
