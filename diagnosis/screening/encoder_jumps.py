"""Angles that jump between two rows and keep the offset: counts that an encoder lost or added.

Searched for in the raw rows of every recording, before a filter would smear them, and removed before the residual is
computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm, Joint
from arm_model.effects.sensing import MISSED_COUNTS
from daq.recording import Recording
from diagnosis.cause import EncoderJump, Estimate
from diagnosis.residual.noise.channels import resolution
from diagnosis.residual.noise.encoder_step import encoder_step, found_once
from diagnosis.screening.event import Event, Gain
from diagnosis.screening.turned_by_reversals import turned_by_reversals

Rows = NDArray[np.intp]
JUMP_IN_STEPS = 2.4
"""Steps of the encoder that a jump must exceed."""
PRINTED = 0.01
"""Of the count of the model's encoder: angles with smaller steps were printed with so many digits. Interpolators of
sines divide a count, seldom by more."""
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
MOST = 0.7
"""Share of a jump with which a link must turn for the motor to have moved: of missed counts, it shows none."""
ANSWER = 0.5
"""Share of a jump by which a servo may turn the joint back in the row after it: it sees the jump as an error."""
ANSWERED = 1.0 / 3.0
"""Share of that turn that the joint made before the row of the jump, and its std: a jump is at any instant between two
rows; from there on at constant acceleration it is 0 to a third, at constant speed 0 to 1."""
SEARCHES = 4
"""Times that an angle is searched, each without the jumps known before."""


def jumps(recordings: Sequence[Recording], arm: Arm) -> list[Event]:
    """Angles that jump by several encoder steps between two rows and keep the offset; one event per joint.

    Its parameters are those of the largest jump; ``encoder_jumps`` has all of them, recording by recording.
    """

    def of_joint(j: int) -> list[tuple[int, Jump]]:
        return [(index, jump) for index, r in enumerate(recordings) for jump in _all_jumps(r, arm, j)]

    by_joint = in_parallel(of_joint, range(recordings[0].joints))
    return [_event(recordings, arm.joints[j], j + 1, found) for j, found in enumerate(by_joint) if found]


def _event(recordings: Sequence[Recording], drive: Joint, joint: int, found: Sequence[tuple[int, Jump]]) -> Event:
    """found: index of a recording and a jump in it, all of one joint (from 1)."""
    index, largest = max(found, key=lambda indexed: abs(indexed[1].size))
    steps = {k: _count(recordings[k].q[:, joint - 1], drive) for k, _ in found}
    step, size, r = steps[index], largest.size, recordings[index]
    elsewhere = f", as at {len(found) - 1} more instant{'s' if len(found) > 2 else ''}" if len(found) > 1 else ""
    showing = tuple(dict.fromkeys(k for k, _ in found))
    return Event(
        effect=MISSED_COUNTS.name,
        joint=joint,
        parameters=[
            Estimate("counts", float(np.round(size / step)), _std(largest, step), "1"),
            Estimate("time", float(r.t[largest.row]), r.dt, "s"),
            Estimate("resolution", step, 0.01 * step, "rad"),
        ],
        evidence=f"the angle of joint {joint} jumps by {size:.3g} rad between two rows at {r.t[largest.row]:.3f} s of "
        f"{r.path.name} and keeps that offset{elsewhere} "
        f"({len(showing)} of {len(recordings)} recordings show a jump)",
        recordings=showing,
        gain=Gain(before=abs(size), after=float(abs(size - step * np.round(size / step))), unit="rad", joint=joint),
        encoder_jumps=tuple(
            EncoderJump(
                file=recordings[k].path.name,
                joint=joint,
                row=jump.row,
                time=float(recordings[k].t[jump.row]),
                counts=round(jump.size / steps[k]),
                std=_std(jump, steps[k]),
            )
            for k, jump in found
        ),
    )


def _std(jump: Jump, step: float) -> float:
    """Std of the number of counts of a jump; step: rad of one."""
    return max(1.0, 0.01 * abs(jump.size / step), jump.std / step)


def turned_per_row(q: Array, row: int, dt: float) -> float:
    """rad: turn of an angle (m,) per row about a row, without the step there."""
    near = rows_near(dt)
    return float(q[row - 1] - q[row - near] + q[row + near - 1] - q[row]) / (2 * (near - 1))


def _count(q: Array, joint: Joint) -> float:
    """rad: one count of an encoder: the step of its angle (n,), or if that has none, of the model's encoder.

    A step far finer than that of the model's encoder comes from the digits of a text file.
    """
    step = encoder_step(q)
    of_model = 0.0 if joint.encoder_lines is None else 2 * np.pi / (4 * joint.encoder_lines * abs(joint.ratio))
    return of_model if step < PRINTED * of_model else step or of_model or resolution(q)


def _all_jumps(recording: Recording, arm: Arm, j: int) -> list[Jump]:
    """The jumps of an angle that stay, in time, without those that motion may be.

    Searched for again where the known ones are taken out: one that is close to a larger jump shows only then.
    """
    q, found = recording.q[:, j].copy(), list[Jump]()
    t = _instants(recording, q)
    for _ in range(SEARCHES):
        further = [jump for row, size in _steep(q, t) if (jump := _staying(q, t, row, size)) is not None]
        if not further:
            break
        found += further
        q = _without(q, further)
    motion = [
        jump
        for jump in found
        if _followed(recording, j, jump)
        or _struck(recording, j, jump)
        or abs(jump.size) <= turned_by_reversals(recording, arm, j, jump.row)
    ]
    sized = [_whole(recording, j, _by_link(recording, j, jump)) for jump in found if jump not in motion]
    return sorted(sized, key=lambda jump: jump.row)


def _by_link(recording: Recording, j: int, jump: Jump) -> Jump:
    """The jump with the size that a link encoder shows, if the joint has one: its link does not jump."""
    beside = _beside_link(recording, j, jump)
    return beside if beside is not None and abs(beside.size - jump.size) <= STAYS * abs(jump.size) else jump


def _followed(recording: Recording, j: int, jump: Jump) -> bool:
    """Whether the link of a joint turns with most of a jump of its motor's angle: then both moved."""
    beside = _beside_link(recording, j, jump)
    return beside is not None and abs(beside.size) < (1.0 - MOST) * abs(jump.size)


def _beside_link(recording: Recording, j: int, jump: Jump) -> Jump | None:
    """How the angle of a motor departs from that of its link at a jump; None without samples of a link encoder."""
    if recording.ql is None:
        return None
    near = rows_near(recording.dt)
    apart = recording.q[jump.row - near : jump.row + near, j] - recording.ql[jump.row - near : jump.row + near, j]
    if np.isnan(apart).any():
        return None
    sides = [apart[:near], apart[near:]]
    size = float(np.median(sides[1]) - np.median(sides[0]))
    return Jump(jump.row, size, float(np.sqrt(sum(float(np.var(side)) for side in sides) / near)))


def _whole(recording: Recording, j: int, jump: Jump) -> Jump:
    """The jump in whole steps of its encoder, if that has any."""
    step = encoder_step(recording.q[:, j])
    return replace(jump, size=step * round(jump.size / step)) if step else jump


def _struck(recording: Recording, j: int, jump: Jump) -> bool:
    """Whether another angle turns abruptly at a jump as well, and by as much: then the arm was struck.

    Where the teeth of a gap meet, a joint at rest is moved by some counts, and its friction holds it there. Counts that
    one encoder misses leave the other angles as they are; what the servo then does moves them by less. The blow falls
    between two rows: a joint at rest may be fastest in the row after.
    """
    for other in np.delete(recording.q, j, axis=1).T:
        # by how much it turns more than in the row before
        faster = np.abs(np.diff(other, n=2))
        abrupt = max(JUMP_IN_STEPS * encoder_step(other), JUMP_OVER_OTHERS * _usual(faster))
        blow = float(np.max(faster[max(jump.row - 3, 0) : jump.row - 1]))
        if np.ptp(other) > 0.0 and blow >= max(abrupt, abs(jump.size)):
            return True
    return False


def _without(q: Array, removed: Sequence[Jump]) -> Array:
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
    found = [_staying(q, t, row, size) for row, size in _steep(q, t)]
    return tuple(sorted((jump for jump in found if jump is not None), key=lambda jump: jump.row))


def _instants(recording: Recording, q: Array) -> Array:
    """(m,) s of the rows of an angle (m,): as stamped, or equally spaced; the ones at which it turns more evenly.

    Instants that jitter by 2 % of 8 ms make jumps of 0.4 mrad of an angle that turns at 2.5 rad/s; but stamps may be of
    the host, and jitter more than the instants.
    """
    even: Array = recording.dt * np.arange(len(q), dtype=float)
    if len(q) < 8 * rows_near(recording.dt):
        return even
    return recording.t if _usual(_beyond(q, recording.t)) < _usual(_beyond(q, even)) else even


def _beyond(q: Array, t: Array) -> Array:
    """(m - 1,) rad by which an angle (m,) turns more from row to row than at the speed of the rows beside."""
    steps = np.diff(t)
    return np.asarray(np.diff(q) - steps * signal.medfilt(np.diff(q) / steps, 2 * (rows_near(_period(t)) // 2) + 1))


def _usual(beyond: Array) -> float:
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
    least = max(JUMP_IN_STEPS * step, JUMP_OVER_OTHERS * _usual(beyond))
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


def without_jumps(recording: Recording, arm: Arm, index: int, events: list[Event]) -> Array:
    """(n, J) rad: the angles of recording ``index`` without its jumps."""
    q = recording.q.copy()
    for event in events:
        if event.effect == MISSED_COUNTS.name and event.joint is not None and index in event.recordings:
            j = event.joint - 1
            q[:, j] = _without(q[:, j], _all_jumps(recording, arm, j))
    return q
