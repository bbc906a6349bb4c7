"""How far residual currents are above the noise of the instruments."""

from __future__ import annotations

import numpy as np
from scipy import stats

from arm_io.types import Array
from arm_model import Arm
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.noise.channels import QUIET_BLOCKS, is_stationary, quiet_stds
from diagnosis.selection.design import Dataset

SLOW = 0.25
"""s: correlation of noise that the initial standstill hardly shows, and that is no finding."""
BY_CHANCE = 0.01
"""Probability by which noise in a short time exceeds its limit, if in a longer one it does as often."""


def joints_above_noise(residual: Array, side: Dataset, arm: Arm) -> list[int]:
    """Joints whose ``residual`` (n * rows,) exceeds the noise, the largest residual-to-noise ratio first."""
    by_joint = {joint: noise_ratio(residual, side, joint) for joint in range(1, len(arm) + 1)}
    return sorted(
        (joint for joint, value in by_joint.items() if value > largest_of_noise(side, joint)),
        key=lambda joint: -by_joint[joint],
    )


def largest_of_noise(side: Dataset, joint: int) -> float:
    """Ratio up to which a residual of a joint is noise: LIMITS.above_noise, or more where the joint moves briefly.

    More also where the joint is noisier while it rests than the instruments are known to be.

    The rms of slow noise scatters: with a correlation that falls to 1/e in T s, a time t counts as t / T values. From
    so many seconds on as its steadiness is judged in, the limit stands; in a shorter time, noise exceeds the larger
    limit by the same chance.
    """
    rows = sum(np.count_nonzero(comparable_rows(run)[:, joint - 1]) / run.per_second for run in side.runs)
    few, usual = (_highest(max(seconds, SLOW) / SLOW) for seconds in (rows, float(QUIET_BLOCKS)))
    return LIMITS.above_noise * max(few / usual, 1.0) * max(noise_at_rest(side, joint), 1.0)


def noise_at_rest(side: Dataset, joint: int) -> float:
    """Noise of a current in the seconds in which its joint rests, over that of the instruments; 0 where there are few.

    Slow noise shows there that the initial standstill is too short for. Of the seconds the quietest fifth counts,
    about straight lines: in others the servo holds against what moves.
    """
    stds = [quiet_stds(run.residual[:, joint - 1], run.t, run.brisk_v[:, joint - 1] == 0.0) for run in side.runs]
    over = np.concatenate([std / run.noise[joint - 1] for std, run in zip(stds, side.runs)])
    return float(np.quantile(over, 0.2)) if len(over) >= QUIET_BLOCKS else 0.0


def _highest(count: float) -> float:
    """Rms of so many independent values of unit variance that is exceeded by BY_CHANCE."""
    return float(np.sqrt(stats.chi2.isf(BY_CHANCE, count) / count))


def noise_ratio(residual: Array, side: Dataset, joint: int) -> float:
    """Rms of ``residual`` (n * rows,) over its noise std, at one joint, where the joint moves.

    1 for pure noise; less if the instruments are better than their stated noise.

    Only rows count in which the noise is that of the instruments. Noise correlated over longer than the initial
    standstill is underestimated; it is as large in the quietest seconds as in all others, and then the ratio is 1.
    """
    comparable = side.comparable(joint)
    if not comparable.any():
        return 1.0
    of_joint, block = residual[side.of(joint)], side.block[side.of(joint)]
    ratio = float(np.sqrt(np.mean(of_joint[comparable] ** 2)))
    far = ratio > LIMITS.far_above_noise
    return ratio if far or not is_stationary(of_joint, block, np.flatnonzero(comparable)) else min(ratio, 1.0)
