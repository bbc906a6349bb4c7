"""A current that oscillates while the arm stands: a servo that hunts about rest, which no effect of the catalogue is.

It is no noise of the instrument either. Noise, white or correlated, follows no wave for long, and none of the same
frequency in every recording. And it is there while a joint moves as well: a current that varies far more while the arm
stands than in the quietest stretches of the motion shows more than noise, whether it follows one frequency or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from daq.recording import Recording
from diagnosis.cause import Signal, Structure
from diagnosis.residual.filters import COMPARE_BAND, low_pass
from diagnosis.residual.noise.channels import END_SECONDS, STILL_SECONDS, angle_noise, floor, standstill
from diagnosis.residual.run_setup import has_demand

SHARE = 0.75
"""Of the variance of a standing current that a wave must predict; of noise it is 0.2 to 0.7 over half a second."""
PERIODS = 2.5
"""That must fit into the standstill: slower waves are drifts."""
SAME = 1.0
"""Hz by which the frequencies of recordings may differ."""
LASTS = 0.5
"""Amplitude in one half over that in the other: a servo that settles is no oscillation, nor a motion that begins before
a coarse encoder shows it."""
STEP = 0.1
"""Hz between frequencies that are tried."""
ABOVE_MOVING = 5.0
"""Std of a standing current over that of the quietest moving stretches of its joint, from which on it is no noise.

The least standing one of all recordings over the quietest moving one. Of joints without an oscillation 0.01 to 2.0:
motion adds to the noise, and takes nothing of it.
"""
QUIETEST = 0.2
"""Share of the moving stretches that are the quietest."""
STRETCHES = 5
"""Quietest stretches that there must be."""
STARTS = 1e-4
"""Share of a joint's range by which its demand must leave the first one for a motion to begin."""
MOSTLY = 0.5
"""The share where the arm is only asked to stand: a motion that begins before its demand is no wave (0.2 at most)."""
MOVES = 8.0
"""Noise of an angle that a joint must turn by in each of the ``PARTS`` of a stretch to be moving throughout."""
PARTS = 10
"""Parts of a stretch in each of which a joint must turn."""


@dataclass(frozen=True)
class Oscillation:
    """Of the current of a joint (from 1): Hz, A, and its share of the variance, the least of all recordings."""

    joint: int
    frequency: float
    amplitude: float
    share: float

    def structure(self, unit: str) -> Structure:
        """As what no effect explains."""
        size = f"{self.amplitude:.2g} {unit} while the arm is at rest"
        return Structure(Signal.CURRENT, self.joint, f"a wave of {self.frequency:.1f} Hz", self.share, size)


@dataclass(frozen=True)
class _Standing:
    """The standing current of one joint in one recording.

    frequency, amplitude, share  Hz, A of the current, and share of the wave that predicts most
    lasts        whether it goes on, and is larger than the scatter from row to row
    std, moving  A: its std, and that of the quietest moving stretches (``_about_cubics``)
    """

    frequency: float
    amplitude: float
    share: float
    lasts: bool
    std: float
    moving: float


def oscillations(recordings: Sequence[Recording]) -> list[Oscillation]:
    """Currents that oscillate in the standstill of every recording that has one; recordings with drives on."""
    at_rest = [(recording, rows) for recording in recordings if (rows := _at_rest(recording)) is not None]
    of_each = [_standing(recording, rows) for recording, rows in at_rest]
    least = 0.0 if all(standstill(recording) for recording, _ in at_rest) else MOSTLY
    oscillating = []
    for joint, currents in enumerate(zip(*of_each), 1):
        share, frequencies = min(one.share for one in currents), [one.frequency for one in currents]
        one_wave = share > SHARE and np.ptp(frequencies) <= SAME
        quietest = min((one.moving for one in currents if np.isfinite(one.moving)), default=np.inf)
        no_noise = share > least and min(one.std for one in currents) > ABOVE_MOVING * quietest
        if all(one.lasts for one in currents) and (one_wave or no_noise):
            amplitude = np.mean([one.amplitude for one in currents])
            oscillating.append(Oscillation(joint, float(np.median(frequencies)), float(amplitude), share))
    return oscillating


def _at_rest(recording: Recording) -> slice | None:
    """Rows in which the arm stands; else those in which it is asked to: a joint that hunts widely stands nowhere."""
    if (rows := standstill(recording)) is not None or not has_demand(recording):
        return rows
    rate, demand = 1.0 / recording.dt, np.asarray(recording.qref, float)
    begun = np.any(np.abs(demand - demand[0]) > STARTS * np.ptp(demand, axis=0), axis=1)
    first, last = int(END_SECONDS * rate), int(np.argmax(begun)) if begun.any() else len(demand)
    return slice(first, last) if last - first > STILL_SECONDS * rate else None


def _standing(recording: Recording, rows: slice) -> list[_Standing]:
    """The currents of all joints in a standstill."""
    t, white = recording.t[rows] - recording.t[rows][0], floor(recording.i)
    below = low_pass(recording.i, COMPARE_BAND, 1.0 / recording.dt)
    values, (std, moving) = below[rows], _about_cubics(below, recording.q, rows)
    straight = np.column_stack([np.ones_like(t), t])
    values = values - straight @ np.linalg.lstsq(straight, values, rcond=None)[0]
    power = np.maximum(np.sum(values**2, axis=0), 1e-300)
    frequencies = np.arange(PERIODS / t[-1], COMPARE_BAND, STEP)
    residual = np.array([np.sum((values - _fitted(f, t, values)) ** 2, axis=0) for f in frequencies])
    best, half = np.argmin(residual, axis=0), len(t) // 2
    standing = []
    for j, k in enumerate(best):
        parts = [values[rows_of, j] for rows_of in (slice(None), slice(None, half), slice(half, None))]
        amplitude, early, late = (float(np.sqrt(2.0) * np.std(part)) for part in parts)
        lasts = min(early, late) > LASTS * max(early, late) and amplitude > white[j]
        share = float(1.0 - residual[k, j] / power[j])
        standing.append(_Standing(float(frequencies[k]), amplitude, share, lasts, float(std[j]), float(moving[j])))
    return standing


def _about_cubics(current: Array, q: Array, rows: slice) -> tuple[Array, Array]:
    """(n,) std of currents (m, n) A in the standstill ``rows``, and of the quietest moving stretches as long.

    About cubics, which follow drifts and the slow part of a motion. q (m, n) rad. NaN for too few stretches in which a
    joint moves throughout.
    """
    length = rows.stop - rows.start
    count, joints = (len(q) - rows.stop) // length, q.shape[1]
    cubics = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), 4))[0]

    def stretches(values: Array) -> Array:
        return values[rows.stop : rows.stop + count * length].reshape(count, length, joints)

    def std(values: Array) -> Array:
        return np.asarray(np.std(values - cubics @ (cubics.T @ values), axis=-2))

    turned = np.abs(np.diff(stretches(q)[:, :: max(1, length // PARTS)], axis=1)).min(axis=1, initial=np.inf)
    moving = np.where(turned > MOVES * angle_noise(q), std(stretches(current)), np.nan)
    quietest = np.full(joints, np.nan)
    for j in np.flatnonzero(np.isfinite(moving).sum(axis=0) >= STRETCHES):
        quietest[j] = float(np.nanquantile(moving[:, j], QUIETEST))
    return std(current[rows]), quietest


def _fitted(frequency: float, t: Array, values: Array) -> Array:
    """(m, n) the wave of a frequency, Hz, with a straight line, that is nearest to values (m, n) at t (m,) s."""
    turn = 2 * np.pi * frequency * t
    columns = np.column_stack([np.sin(turn), np.cos(turn), np.ones_like(t), t])
    return np.asarray(columns @ np.linalg.lstsq(columns, values, rcond=None)[0], float)
