"""What tracked points do over time, whatever the arm does: they ring at a frequency, or they drift.

A tripod that is struck rings at some hertz; a stand or a base that warms creeps. Neither is a function of the angles,
and a wave smaller than the noise of one point is far above the noise of thousands.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import ndimage, signal

from arm_io.types import Array
from diagnosis.cause import Signal, Structure
from diagnosis.measurements.tracker.points import Side
from diagnosis.measurements.tracker.regression import good
from diagnosis.selection.waves import SLOWEST
from identification.selection import BLOCK_SECONDS

LEAST = 0.35
"""Rms of a wave or a drift over the noise of a coordinate, from which it counts: an eighth of the noise's energy."""
NEIGHBOURS = 61
"""Bins around a line whose median power is its floor."""
OVER_FLOOR = 20.0
"""Power of a line over its floor: a bin of noise exceeds it with a probability of e^-14."""
SHARP = 4.0
"""Std by which a drift must exceed what blocks of one second scatter about it."""


def over_time(side: Side, residual: Array, level: float) -> list[Structure]:
    """Waves and drifts of the residual (N, 3) m of points, one of each at most, in the recording with the largest.

    level: m, noise of a coordinate.
    """
    keep = good(residual)
    energy, structures = float(np.sum(residual[keep] ** 2)), list[_TimeStructure]()
    for recording in np.unique(side.of):
        of_recording = keep & (side.of == recording)
        if of_recording.sum() > 2 * NEIGHBOURS:
            structures += [
                *_waves(side.t[of_recording], residual[of_recording], level),
                *_drifts(side.t[of_recording], residual[of_recording], level),
            ]
    kinds = [[one for one in structures if one.drifts == drifts] for drifts in (False, True)]
    return [
        Structure(Signal.TRACKER, None, one.against, min(1.0, one.energy / energy), one.size)
        for one in (max(kind, key=lambda each: each.energy) for kind in kinds if kind)
    ]


class _TimeStructure(NamedTuple):
    """Energy, m^2, of a wave or a drift of a recording; its name and its size as in ``Structure``."""

    energy: float
    against: str
    size: str
    drifts: bool


def _waves(t: Array, residual: Array, level: float) -> Iterator[_TimeStructure]:
    """Energy and name of the strongest line above the spectrum beside it, all coordinates together."""
    step = float(np.median(np.diff(t)))
    even = np.arange(t[0], t[-1], step)
    values = np.stack([np.interp(even, t, column) for column in residual.T], axis=1)
    frequency, power = signal.periodogram(values, 1.0 / step, window="hann", axis=0)
    power = power.sum(axis=1)
    floor = ndimage.median_filter(power, NEIGHBOURS, mode="nearest")
    over = np.where(frequency > SLOWEST, power / np.maximum(floor, 1e-300), 0.0)
    top = int(np.argmax(over))
    near = slice(max(0, top - 2), top + 3)
    rms = float(np.sqrt(np.sum((power - floor)[near].clip(0.0)) * frequency[1]))
    if over[top] > OVER_FLOOR and rms > LEAST * level:
        yield _TimeStructure(
            rms**2 * len(t), f"a wave of {frequency[top]:.1f} Hz", f"{1e3 * rms:.2g} mm rms", drifts=False
        )


def _drifts(t: Array, residual: Array, level: float) -> Iterator[_TimeStructure]:
    """Energy and size of a straight line over time that blocks of one second confirm."""
    x, residual = t - t.mean(), residual - residual.mean(axis=0)
    slope = residual.T @ x / (x @ x)
    block = (t // BLOCK_SECONDS).astype(int)
    scores = np.stack(
        [np.bincount(block, weights=column) for column in (x[:, None] * (residual - np.outer(x, slope))).T]
    )
    std = np.sqrt(np.sum(scores**2, axis=1)) / (x @ x)
    rms = float(np.sqrt(np.sum(slope**2) * np.mean(x**2)))
    if np.max(np.abs(slope) / np.maximum(std, 1e-300)) > SHARP and rms > LEAST * level:
        seconds = t[-1] - t[0]
        way = 1e3 * float(np.linalg.norm(slope)) * seconds
        yield _TimeStructure(rms**2 * len(t), "time", f"{way:.2g} mm in {seconds:.0f} s", drifts=True)
