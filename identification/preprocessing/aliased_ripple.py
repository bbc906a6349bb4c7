"""Servo ripple that sampling folds onto the motion, where no residual shows it.

How far it may put a joint's inertia wrong.

The host sends a setpoint every T s, servos follow a broken line, and every corner causes a transient in the currents in
proportion to the acceleration. Seen at times, these transients are spectral lines at whole multiples of 1/T, modulated
by the acceleration. Sampled n times per setpoint, the line at n/T falls onto 0 Hz: what is recorded is torque + c q'',
where c depends on the phase of the two clocks. The columns of a joint's own inertia say the same, so that the fit is
wrong by c and its residual is as small as ever (measured on the simulated Puma: ``docs/identification.md``).

The lines below half the sampling rate are seen. A held command falls with its frequency f at least as 1/f, a lag makes
it fall faster, so that the lines seen bound the one that is not.
"""

from __future__ import annotations

import numpy as np
from scipy import signal

from arm_io.types import Array
from arm_model import Arm
from identification.preprocessing.filtering import zero_phase
from identification.preprocessing.setpoint_lines import seen_rows
from identification.preprocessing.signals import Motion, smooth_motion

BEAT = 1.0  # Hz
BESIDE = 0.4  # of the setpoints' rate, from a multiple of it
STANDS = 0.1  # of a joint's rms acceleration: a stretch with less shows no ripple that it causes
UNSEEN = 2  # rows per setpoint of which no line shows how much folds
SLOW = 10.0  # Hz: accelerations below it are demanded, where the setpoints' rate is not stated
STRETCH = 5.0  # s in which two clocks stay in phase to a fraction of a line's period


def rows_a_setpoint(arm: Arm, dt: float) -> int:
    """Rows, dt s apart, per setpoint of the arm's controller if their beat is slower than BEAT, else 0.

    A quicker beat changes its sign many times in a run: it is seen as a residual, and the blocks of ``uncertainty``
    count it.
    """
    period = 0.0 if arm.controller is None else arm.controller.setpoint_period
    rows = round(period / dt)
    return rows if rows > 1 and abs(rows / period - 1 / dt) <= BEAT else 0


def drifting(folded: Array, t: Array) -> Array:
    """(m, 2, ...): ``folded`` (m, ...) at t (m,) s of a run with clocks in phase, and its drift as they diverge."""
    along = (2 * t / max(t[-1], 1e-9) - 1).reshape(-1, *[1] * (folded.ndim - 1))
    return np.stack([folded, folded * along], axis=1)


def rate_beside(period: float, rate: float) -> float:
    """``rate`` Hz, or the next lower one at which the ripple of setpoints every ``period`` s is far from the motion.

    0.4 of the setpoints' own rate beside a multiple. A period of 0: of an arm without a controller.
    """
    rows = round(rate * period)
    return rate if rows < 2 or abs(rate * period - rows) > BESIDE / 2 else round((rows - BESIDE) / period, 2)


def setpoint_rows(arm: Arm, motion: Motion, t: Array, torque: Array) -> int:
    """Rows per setpoint of recorded torques (n, J) at t (n,) s from the motion's start; 0 where nothing folds.

    Of an arm without a controller, whose setpoints nobody has stated, those that the torques show.
    """
    if arm.controller is not None:
        return rows_a_setpoint(arm, motion.dt)
    pushed = _at(t, motion.t, _below(min(motion.band.parallel, SLOW), motion))
    return seen_rows(torque - _at(t, motion.t, motion.torque), pushed, 1 / motion.dt)


def folded_torque(arm: Arm, motion: Motion, t: Array, torque: Array, rows: int | None = None) -> Array | None:
    """(m, J) N m (N) on the motion's grid.

    One standard deviation of c q'' above, of recorded torques (n, J) at t (n,) s from the motion's start. ``rows`` per
    setpoint: by default ``setpoint_rows``.

    None where nothing folds, and of two stated rows a setpoint, where no line is seen. Two deviations bound c at any
    phase.
    """
    rows = setpoint_rows(arm, motion, t, torque) if rows is None else rows
    lines = np.arange(max(1, -(-rows // 4)), (rows + 1) // 2)
    if rows == UNSEEN and arm.controller is None:
        lines = np.array([1])
    if not len(lines):
        return None
    period = rows * float(t[-1] - t[0]) / (len(t) - 1) if arm.controller is None else arm.controller.setpoint_period
    # The acceleration that is demanded, without the transients themselves.
    acceleration = _below(min(motion.band.parallel, 0.5 / period), motion)
    pushed, ripple = _at(t, motion.t, acceleration), torque - _at(t, motion.t, motion.torque)
    angle = 2 * np.pi * t[:, None] * lines / period
    # two rows a setpoint show one phase of their line: what folds may be twice as large as by both
    of_phase = [np.cos(angle) / 2] if rows == UNSEEN else [np.cos(angle), np.sin(angle)]
    deviation = np.zeros(len(arm))
    for j in np.flatnonzero(motion.usable.any(axis=0)):
        transients = pushed[:, [j]] * np.concatenate(of_phase, axis=1)
        deviation[j] = _deviation(t, transients, ripple[:, j], lines / rows)
    return np.asarray(acceleration * deviation)


def _deviation(t: Array, transients: Array, ripple: Array, order: Array) -> float:
    """One standard deviation of c: transients (n, k) of lines of these orders (l,) of the rate, in a ripple (n,)."""
    power, least = [], STANDS * np.std(transients[:, 0])
    for stretch in np.array_split(np.arange(len(t)), max(1, int(t[-1] / STRETCH))):
        here = stretch[np.isfinite(ripple[stretch])]
        if len(here) > 10 * transients.shape[1] and np.std(transients[here, 0]) > least:
            amplitude = np.linalg.lstsq(transients[here], ripple[here], rcond=None)[0].reshape(-1, len(order))
            power.append(np.mean(np.sum(amplitude**2, axis=0) * order**2))
    return float(np.sqrt(np.mean(power))) / 2 if power else 0.0


def _below(cut: float, motion: Motion) -> Array:
    """(m, J) the acceleration of a motion below ``cut`` Hz."""
    low_pass = signal.butter(4, min(2 * cut * motion.dt, 0.98), output="sos")
    return zero_phase(low_pass, motion.qdd)


def _at(t: Array, grid: Array, values: Array) -> Array:
    """Values (m, J) on a grid (m,) s, at times t (n,) s."""
    return np.column_stack([np.interp(t, grid, column) for column in values.T])


def folded_along(arm: Arm, t: Array, q: Array, torque: Array, rows: int) -> Array | None:
    """(n, J) N m (N): ``folded_torque`` of recorded angles q (n, J) and torques (n, J), at their own times t (n,) s.

    None where nothing folds, and of two stated rows a setpoint: how much folds is not known, and such currents do not
    determine an inertia.
    """
    if rows == 0 or (rows == UNSEEN and arm.controller is not None):
        return None
    motion = smooth_motion(t, q, torque)
    along = folded_torque(arm, motion, t - t[0], torque, rows)
    return None if along is None else _at(t - t[0], motion.t, along)
