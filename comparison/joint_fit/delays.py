"""By how much later the currents of the side after are read: the delay beside which the joint fit leaves least.

It is begun at the coefficient of its column, and at the likeliest of some delays, and refined by that coefficient with
the torques put back (``search``). Only where the fit with it leaves less than that without a delay is it one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from arm_io.types import Array
from comparison.joint_fit.effect_columns import with_columns
from comparison.joint_fit.effects import SKEW, always
from comparison.joint_fit.joint_regression import joint_regression
from comparison.joint_fit.search import JointFit, Recorded, first_fit
from comparison.joint_fit.selection import akaike
from comparison.regression import Rows
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, parallel_filter

DELAYS = (3e-3, 6e-3, 12e-3, 24e-3, 48e-3)
"""s, of either sign, and none: from one to the next, motions of 5 Hz differ by as little as their first order."""
EXACT = 0.02
"""Share of a delay to which it is refined."""
STEPS = 4
"""Fits by which it is refined at most."""


def undelayed(motion: Motion, delay: float) -> Motion:
    """The motion with its torques put back by ``delay`` (s), each of their frequencies by its phase.

    Splines between rows would take away some of the noise.
    """
    both = np.concatenate([motion.torque, motion.torque[::-1]])  # which leaves no step where the ends meet
    frequency = fft.rfftfreq(len(both), motion.dt)[:, None]
    back = fft.irfft(fft.rfft(both, axis=0) * np.exp(2j * np.pi * frequency * delay), len(both), axis=0)
    return replace(motion, torque=np.asarray(back[: len(motion.torque)]))


def put_back(motions: Sequence[Motion], is_before: NDArray[np.bool_], delay: float) -> list[Motion]:
    """The motions, those of the side after with their torques put back by ``delay`` (s)."""
    return [motion if before else undelayed(motion, delay) for motion, before in zip(motions, is_before)]


def delay_between(recorded: Recorded, fitted: JointFit) -> float:
    """s by which currents are read later than before, where that explains more than other changes do; else 0.

    fitted: of ``recorded``, without a delay and without ripples.
    """
    best = 0.0, akaike(fitted.fit, fitted.found)
    for start in {_found(fitted), _likeliest(recorded)} - {0.0}:
        delay = start
        for _ in range(STEPS):
            fitted = first_fit(_put_back(recorded, delay))
            found = _found(fitted)
            if not found or abs(found - delay) <= EXACT * abs(delay):
                break
            delay = found
        left = akaike(fitted.fit, fitted.found)
        if found and left < best[1]:
            best = delay, left
    return best[0]


def _found(fitted: JointFit) -> float:
    """The change of the delay (s) that entered the fit; 0 of none."""
    for one in fitted.found:
        if one.hypothesis.added == SKEW:
            return float(one.changes @ one.hypothesis.directions[:, 0])
    return 0.0


def _put_back(recorded: Recorded, delay: float) -> Recorded:
    """With the torques of the side after put back; the fits of single recordings stay as they were."""
    motions = put_back(recorded.motions, recorded.is_before, delay)
    rows = [
        replace(part, y=part.y + _in_rows(now.torque - motion.torque, motion))
        for part, now, motion in zip(recorded.rows, motions, recorded.motions)
    ]
    return replace(recorded, motions=motions, rows=rows, delay=delay)


def _in_rows(torque: Array, motion: Motion) -> Array:
    """(k,) torques (m, J) in the rows of a recording."""
    joint, row = np.nonzero(equation_rows(motion)[1].T)
    return np.asarray(parallel_filter(motion, torque * equation_weight(motion))[row, joint])


def _likeliest(recorded: Recorded) -> float:
    """The one of ``DELAYS`` (or none) with the smallest residual, besides a delay that all recordings have."""
    tried = [0.0, *(sign * size for size in DELAYS for sign in (1.0, -1.0))]
    rows = _with_tried(recorded, tried)
    fit = joint_regression(recorded.structure, rows, recorded.fits, recorded.is_before, recorded.drift)
    last = len(fit.total) - fit.scales
    first = last - 2 * len(tried)
    left = []
    for place in range(first, last, 2):
        # the torques with the nonlinear part of the delay, whose column is that over its scale, of the side after alone
        more = 1.0 / fit.scale[place + 1]
        beyond = more * fit.total[place + 1]
        size = more * (2.0 * fit.moment[place + 1] + beyond[place + 1])
        columns, change = np.append(np.arange(first), place), np.eye(len(fit.scale))[:, place : place + 1]
        left.append(size - fit.explained(columns, change, fit.moment + beyond, fit.moment_after + beyond))
    return tried[int(np.argmin(left))]


def _with_tried(recorded: Recorded, tried: Sequence[float]) -> list[Rows]:
    """Rows with two columns per delay: of another delay near it, and of what the delay does beyond its first order."""
    first = always(recorded.structure.arm, recorded.motions)
    first.remove(SKEW)
    found = []
    every = zip(recorded.rows, recorded.motions, recorded.columns, recorded.is_before)
    for part, motion, of_effects, before in every:
        columns = [of_effects.of(first, motion.torque)]
        for delay in tried:
            now = motion if before else undelayed(motion, delay)
            rate = of_effects.of([SKEW], now.torque)
            beyond = _in_rows(now.torque - motion.torque, motion) + delay * rate[:, 0]
            columns += [rate, beyond[:, None] if not before else np.zeros_like(rate)]
        found.append(with_columns(part, np.concatenate(columns, axis=1)))
    return found
