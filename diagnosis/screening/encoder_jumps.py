"""Angles that jump between two rows and keep the offset: counts that an encoder lost or added.

Searched for in the raw rows of every recording, before a filter would smear them, and removed before the residual is
computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io import counted
from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm, Joint
from arm_model.effects.sensing import MISSED_COUNTS
from daq.recording import Recording
from diagnosis.cause import EncoderJump, Estimate
from diagnosis.residual.noise.channels import resolution
from diagnosis.residual.noise.encoder_step import encoder_step
from diagnosis.screening.angle_jumps import (
    JUMP_IN_STEPS,
    JUMP_OVER_OTHERS,
    STAYS,
    Jump,
    instants_of,
    jumps_at,
    rows_near,
    usual_beyond,
    without,
)
from diagnosis.screening.event import Event, Gain
from diagnosis.screening.turned_by_reversals import turned_by_reversals

PRINTED = 0.01
"""Of the count of the model's encoder: angles with smaller steps were printed with so many digits. Interpolators of
sines divide a count, seldom by more."""
MOST = 0.7
"""Share of a jump with which a link must turn for the motor to have moved: of missed counts, it shows none."""
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
    step, size, r = _count([each.q[:, joint - 1] for each in recordings], drive), largest.size, recordings[index]
    elsewhere = f", as at {counted(len(found) - 1, 'more instant')}" if len(found) > 1 else ""
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
                counts=round(jump.size / step),
                std=_std(jump, step),
            )
            for k, jump in found
        ),
    )


def _std(jump: Jump, step: float) -> float:
    """Std of the number of counts of a jump; step: rad of one."""
    return max(1.0, 0.01 * abs(jump.size / step), jump.std / step)


def _count(angles: Sequence[Array], joint: Joint) -> float:
    """rad: one count of an encoder: the step of its angles (n,) in recordings; if they have none, that of the model.

    The coarsest step of several: angles that were printed with digits not much finer than a count show that count in
    slow motions only, and the digits, or what they have in common with it, in others. A step far finer than that of the
    model's encoder comes from the digits, too.
    """
    step = max(map(encoder_step, angles))
    of_model = 0.0 if joint.encoder_lines is None else 2 * np.pi / (4 * joint.encoder_lines * abs(joint.ratio))
    return of_model if step < PRINTED * of_model else step or of_model or max(map(resolution, angles))


def _all_jumps(recording: Recording, arm: Arm, j: int) -> list[Jump]:
    """The jumps of an angle that stay, in time, without those that motion may be.

    Searched for again where the known ones are taken out: one that is close to a larger jump shows only then.
    """
    q, found = recording.q[:, j].copy(), list[Jump]()
    t = instants_of(recording, q)
    for _ in range(SEARCHES):
        further = jumps_at(q, t)
        if not further:
            break
        found += further
        q = without(q, further)
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
        abrupt = max(JUMP_IN_STEPS * encoder_step(other), JUMP_OVER_OTHERS * usual_beyond(faster))
        blow = float(np.max(faster[max(jump.row - 3, 0) : jump.row - 1]))
        if np.ptp(other) > 0.0 and blow >= max(abrupt, abs(jump.size)):
            return True
    return False


def without_jumps(recording: Recording, arm: Arm, index: int, events: list[Event]) -> Array:
    """(n, J) rad: the angles of recording ``index`` without its jumps."""
    q = recording.q.copy()
    for event in events:
        if event.effect == MISSED_COUNTS.name and event.joint is not None and index in event.recordings:
            j = event.joint - 1
            q[:, j] = without(q[:, j], _all_jumps(recording, arm, j))
    return q
