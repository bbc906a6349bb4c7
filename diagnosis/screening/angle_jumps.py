"""Jumps of one angle between two rows, after which the offset remains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from arm_io.types import Array
from daq.recording import Recording
from diagnosis.residual.noise.encoder_step import encoder_step, found_once

Rows = NDArray[np.intp]
JUMP_IN_STEPS = 2.4
"""Steps of the encoder that a jump must exceed."""
JUMP_OVER_OTHERS = 2.4
"""Ratio to the 99 % quantile of the differences between rows that a jump must exceed."""
BESIDE = 0.15
"""Share of a jump by which the angle may turn more than at its trend in the rows beside.

The teeth of a gap that closes make the motor fast, too, but no row alone.
"""
USUAL_BESIDE = 3.5
"""Times the usual deviation from that trend by which it may, if that is more."""
STAYS = 0.3
"""Share of a jump by which the angles before and after may differ from it."""
ANSWER = 0.5
"""Share of a jump by which a servo may turn the joint back in the row after it: it sees the jump as an error."""
ANSWERED = 1.0 / 3.0
"""Share of that turn that the joint made before the row of the jump, and its std: a jump is at any instant between two
rows; from there on at constant acceleration it is 0 to a third, at constant speed 0 to 1."""


def turned_per_row(q: Array, row: int, dt: float) -> float:
    """rad: turn of an angle (m,) per row about a row, without the step there."""
    near = rows_near(dt)
    return float(q[row - 1] - q[row - near] + q[row + near - 1] - q[row]) / (2 * (near - 1))


def without(q: Array, removed: Sequence[Jump]) -> Array:
    """(m,) an angle without some of its jumps."""
    q = q.copy()
    for jump in removed:
        q[jump.row :] -= jump.size
    return q


@dataclass(frozen=True)
class Jump:
    """An angle jumps by ``size`` rad, of this ``std``, before a row (of the recording), and the offset remains."""

    row: int
    size: float
    std: float = 0.0


@found_once
def jumps_of(q: Array, dt: float) -> tuple[Jump, ...]:
    """All jumps of an angle (m,) that stay, in time."""
    t: Array = dt * np.arange(len(q), dtype=float)
    return tuple(sorted(jumps_at(q, t), key=lambda jump: jump.row))


def jumps_at(q: Array, t: Array) -> list[Jump]:
    """The jumps of an angle (m,) at t (m,) s that stay, the largest first."""
    found = (_staying(q, t, row, size) for row, size in _steep(q, t))
    return [jump for jump in found if jump is not None]


def instants_of(recording: Recording, q: Array) -> Array:
    """(m,) s of the rows of an angle (m,): as stamped, or equally spaced; the ones at which it turns more evenly.

    Instants that jitter by 2 % of 8 ms make jumps of 0.4 mrad of an angle that turns at 2.5 rad/s; but stamps may be of
    the host, and jitter more than the instants.
    """
    even: Array = recording.dt * np.arange(len(q), dtype=float)
    if len(q) < 8 * rows_near(recording.dt):
        return even
    return recording.t if usual_beyond(_beyond(q, recording.t)) < usual_beyond(_beyond(q, even)) else even


def _beyond(q: Array, t: Array) -> Array:
    """(m - 1,) rad by which an angle (m,) turns more from row to row than at the speed of the rows beside."""
    steps = np.diff(t)
    return np.asarray(np.diff(q) - steps * signal.medfilt(np.diff(q) / steps, 2 * (rows_near(_period(t)) // 2) + 1))


def usual_beyond(beyond: Array) -> float:
    return float(np.quantile(np.abs(beyond), 0.99))


def _period(t: Array) -> float:
    return float(np.median(np.diff(t)))


def _steep(q: Array, t: Array) -> list[tuple[int, float]]:
    """Rows before jumps of an angle (m,) at t (m,) s, and their sizes, rad; the largest first."""
    step = encoder_step(q)
    if np.ptp(q) == 0.0 or len(q) < 8 * rows_near(_period(t)):
        return []
    beyond, near, reach = _beyond(q, t), rows_near(_period(t)), _reach(t)
    # a difference within the noise of an angle without steps is no jump
    least = max(JUMP_IN_STEPS * step, JUMP_OVER_OTHERS * usual_beyond(beyond))
    steep = np.flatnonzero((np.abs(beyond) >= least) & (_sharp(q, t) >= JUMP_IN_STEPS * step))
    found: list[tuple[int, float]] = []
    fastest, usual = 0.0, 1.5 * float(np.median(np.abs(beyond)))
    for row in steep[np.argsort(-np.abs(beyond[steep]), kind="stable")].tolist():
        if near < row < len(q) - 2 * near and all(abs(row - place) > near for place, _ in found):
            size = float(beyond[row])
            allowed = max(BESIDE * abs(size), USUAL_BESIDE * usual, 1.5 * step)
            # the trend from the third row on
            beside = np.setdiff1d(row + np.arange(-reach + 1, reach), [*steep, *range(row - 2, row + 3)])
            before = _excess(q, t, row - 1, beside[beside < row])
            after = _excess(q, t, row + 1, beside[beside > row])
            answered = after * size < 0.0 and abs(after) <= ANSWER * abs(size)
            if abs(before) > allowed or (abs(after) > allowed and not answered):
                fastest = max(fastest, abs(size))
            else:
                found.append((row, size))
    # a change as fast as the motion elsewhere is motion
    return [(row, size) for row, size in found if abs(size) >= JUMP_OVER_OTHERS * fastest]


def _excess(q: Array, t: Array, row: int, beside: Rows) -> float:
    """rad by which an angle (m,) turns more in a row than a straight line through its speeds in the rows ``beside``."""
    rows = beside[(beside >= 0) & (beside < len(q) - 1)]
    if len(rows) <= 3:
        return 0.0
    speed = np.polyfit(rows - row, (q[rows + 1] - q[rows]) / (t[rows + 1] - t[rows]), 1)[1]
    return float(q[row + 1] - q[row] - (t[row + 1] - t[row]) * speed)


def _reach(t: Array) -> int:
    """Rows whose speeds make a trend."""
    return min(max(8, round(0.05 / _period(t))), 13)


def _sharp(q: Array, t: Array) -> Array:
    """(m - 1,) rad by which an angle (m,) moves more between two rows than between those before and after.

    A servo that answers a setpoint is fast for several rows, and fastest at one of them: that is no jump.
    """
    steps = np.diff(t)
    rates = np.pad(np.diff(q) / steps, 1, mode="edge")
    return np.asarray(np.abs(np.diff(q) - steps * (rates[:-2] + rates[2:]) / 2))


def _staying(q: Array, t: Array, row: int, size: float) -> Jump | None:
    """A jump after a row whose offset remains: parabolas through the rows before and after differ by it.

    Its size is that between the two rows, because the servo turns the joint back in those that follow.
    """
    near = rows_near(_period(t))
    before, after = slice(max(row - 5 * near, 0), row + 1), slice(row + 1, row + 1 + 5 * near)
    between = (t[row] + t[row + 1]) / 2
    later, earlier = (np.polyval(np.polyfit(t[rows] - between, q[rows], 2), 0.0) for rows in (after, before))
    shift = later - earlier
    return _jump(q, t, row) if abs(shift - size) <= STAYS * abs(size) else None


def _jump(q: Array, t: Array, row: int) -> Jump:
    """The jump after a row: what an angle (m,) turns there beyond the trend of the rows before, and the servo back."""
    before = np.arange(row - _reach(t) + 1, row)
    size, later = (_excess(q, t, one, before) for one in (row, row + 1))
    back = max(0.0, -later * float(np.sign(size)))
    scatter = float(np.std([_excess(q, t, one, before[before != one]) for one in before.tolist() if one >= 0]))
    return Jump(row + 1, size + ANSWERED * back * float(np.sign(size)), float(np.hypot(scatter, ANSWERED * back)))


def rows_near(dt: float) -> int:
    """Rows within which an angle is compared about a jump."""
    return max(3, round(0.01 / dt))
