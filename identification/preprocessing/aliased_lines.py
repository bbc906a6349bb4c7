"""Lines of the setpoints that sampling puts near 0 Hz, at any ratio of the rates of rows and setpoints.

The rate of the rows need not be a multiple of that of the setpoints (``aliased_ripple``): of 5 rows in 2 setpoints, the
fifth line falls onto 0 Hz. Other lines fall beside it, at up to some tens of Hz, where they look like an oscillation:
of setpoints every 10 ms in 240 rows/s, the fifth is seen at 20 Hz.

The lines that are seen elsewhere bound those that are not: a held command falls with its frequency at least as 1/f.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from arm_io.types import Array
from arm_model import Arm
from identification.preprocessing.aliased_ripple import BEAT, STANDS, STRETCH, UNSEEN
from identification.preprocessing.filtering import zero_phase
from identification.preprocessing.signals import Motion, smooth_motion

LINES = 24  # that are followed: the next are below a twentieth of the first
IN_BAND = 25.0  # Hz: nearer to 0 a line is seen in the band of a residual, side bands of the motion included
MOST_BESIDE = 3  # frequencies beside 0 Hz

Lines = NDArray[np.int_]


def period_of(arm: Arm) -> float:
    """s between setpoints of the arm's controller; 0: the model has none."""
    return 0.0 if arm.controller is None else arm.controller.setpoint_period


def whole_rows(period: float, rate: float) -> int:
    """Rows at ``rate`` Hz per setpoint of every ``period`` s if they beat more slowly than BEAT; else 0."""
    rows = round(period * rate)
    return rows if rows > 1 and abs(rows / period - rate) <= BEAT else 0


def folding_line(period: float, rate: float) -> int:
    """The lowest line of setpoints every ``period`` s that rows at ``rate`` Hz put within BEAT of 0 Hz; 0: none.

    As many as rows per setpoint where these are a whole number. Of one row per setpoint, recorder and controller run as
    one: that line is not counted.
    """
    rows = whole_rows(period, rate)
    if rows or period * rate < 1.5:
        return rows
    return next((k for k in range(2, LINES + 1) if _seen_at(np.array([k]), period, rate)[0] <= BEAT), 0)


def _seen_at(lines: Lines, period: float, rate: float) -> Array:
    """Hz at which rows at ``rate`` Hz show lines of setpoints every ``period`` s."""
    frequency = lines / period
    return np.asarray(np.abs(frequency - np.round(frequency / rate) * rate))


def _folded(motion: Motion, t: Array, torque: Array, period: float) -> Array | None:
    """(m, J) N m (N) on the motion's grid: one std of c q'' of ``aliased_ripple``.

    Of recorded torques (n, J) at t (n,) s from the motion's start; None where no line is seen that bounds it.
    """
    line = folding_line(period, 1 / motion.dt)
    if line == 0 or not len(_shown(line, period, 1 / motion.dt)):
        return None
    pushed = _slow(motion.qdd, motion, period)
    return np.asarray(pushed * _bounds([line], motion, pushed, t, torque, period))


def _beside(motion: Motion, t: Array, torque: Array, period: float) -> list[tuple[float, Array]]:
    """Hz, and (m, J) N m (N) on the motion's grid, of lines that sampling puts near 0 Hz, but not onto it.

    One standard deviation of the amplitude that they have there, the largest first; arguments as of ``_folded``.
    """
    rate = 1 / motion.dt
    if period * rate < 1.5:
        return []
    lines = np.arange(1, LINES + 1)
    seen_at = _seen_at(lines, period, rate)
    near = (seen_at > BEAT) & (seen_at < min(IN_BAND, 0.5 / period))
    of_frequency: dict[float, list[int]] = {}
    for line, frequency in zip(lines[near].tolist(), seen_at[near].tolist()):
        if len(_shown(line, period, rate)):
            # lines seen at the same frequency add up
            same = next((other for other in of_frequency if abs(other - frequency) <= BEAT), frequency)
            of_frequency.setdefault(same, []).append(line)
    pushed = _slow(motion.qdd, motion, period) if of_frequency else np.zeros(0)
    found = [
        (frequency, 2 * pushed * _bounds(several, motion, pushed, t, torque, period))
        for frequency, several in of_frequency.items()
    ]
    return sorted(found, key=lambda one: -float(np.sum(one[1] ** 2)))[:MOST_BESIDE]


def _shown(line: int, period: float, rate: float) -> Lines:
    """Lines between a quarter of ``line`` and itself, or below, that are seen far from 0 Hz, each at its own place."""
    lower = np.arange(1, line)
    seen_at = _seen_at(lower, period, rate)
    inside = (seen_at > min(IN_BAND, 0.5 / period)) & (seen_at < rate / 2 - BEAT)
    # of lines seen at the same frequency, the lowest stands for all
    together = np.abs(seen_at[:, None] - seen_at) <= BEAT
    lower = lower[inside & ~np.any(np.tril(together, -1), axis=1)]
    near = lower[lower >= line / 4]
    return near if len(near) else lower


def _slow(values: Array, motion: Motion, period: float) -> Array:
    """(m, J) what is demanded of values (m, J) on the motion's grid, without the transients themselves."""
    cut = min(motion.band.parallel, 0.5 / period)
    low_pass = signal.butter(4, min(2 * cut * motion.dt, 0.98), output="sos")
    return zero_phase(low_pass, values)


def _bounds(lines: list[int], motion: Motion, pushed: Array, t: Array, torque: Array, period: float) -> Array:
    """(J,) kg m2 (kg): std of the sum of ``lines`` per acceleration ``pushed`` (m, J), by the lines that are shown."""
    variance, slow = np.zeros(pushed.shape[1]), _slow(motion.torque, motion, period)
    for line in lines:
        shown = _shown(line, period, 1 / motion.dt)
        angle = 2 * np.pi * t[:, None] * shown / period
        transients = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
        for j in np.flatnonzero(motion.usable.any(axis=0)):
            ripple = torque[:, j] - np.interp(t, motion.t, slow[:, j])
            own = np.interp(t, motion.t, pushed[:, j])[:, None] * transients
            variance[j] += _power(own, ripple, t, shown / line) / 4
    return np.sqrt(variance)


def _power(transients: Array, ripple: Array, t: Array, scale: Array) -> float:
    """Mean squared amplitude of lines with columns ``transients`` (n, 2 k), each times ``scale`` (k,)."""
    power, least = [], STANDS * np.std(transients[:, 0])
    for stretch in np.array_split(np.arange(len(t)), max(1, int(t[-1] / STRETCH))):
        here = stretch[np.isfinite(ripple[stretch])]
        if len(here) > 10 * transients.shape[1] and np.std(transients[here, 0]) > least:
            cosine, sine = np.linalg.lstsq(transients[here], ripple[here], rcond=None)[0].reshape(2, -1)
            power.append(np.mean((cosine**2 + sine**2) * scale**2))
    return float(np.mean(power)) if power else 0.0


def line_onto_zero(t: Array, q: Array, torque: Array, period: float) -> Array | None:
    """(n, J) N m (N): one std of what lines put onto the acceleration unseen, of setpoints every ``period`` s.

    Of recorded angles q (n, J) and torques (n, J), at their own times t (n,) s.

    None where nothing folds, and of two rows a setpoint: how much folds is not known, and such currents do not
    determine an inertia.
    """
    if folding_line(period, (len(t) - 1) / float(t[-1] - t[0])) <= UNSEEN:
        return None
    motion = smooth_motion(t, q, torque)
    along = _folded(motion, t - t[0], torque, period)
    return None if along is None else _at(t, motion, along)


def lines_beside_zero(t: Array, q: Array, torque: Array, period: float) -> list[tuple[float, Array]]:
    """Hz, and (n, J) N m (N) one std of their amplitude, of lines beside 0 Hz; arguments as of ``line_onto_zero``."""
    rate = (len(t) - 1) / float(t[-1] - t[0])
    seen_at = _seen_at(np.arange(1, LINES + 1), period, rate) if period else np.zeros(0)
    if not np.any((seen_at > BEAT) & (seen_at < min(IN_BAND, 0.5 / max(period, 1e-9)))):
        return []
    motion = smooth_motion(t, q, torque)
    return [(hz, _at(t, motion, along)) for hz, along in _beside(motion, t - t[0], torque, period)]


def _at(t: Array, motion: Motion, along: Array) -> Array:
    return np.column_stack([np.interp(t - t[0], motion.t, column) for column in along.T])
