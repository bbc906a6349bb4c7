"""Rows that all counters lost together, at one instant or at several of a recording, while the currents went on.

Every joint that moves then jumps at one row by what it turned in the lost rows. The number of rows is the mean of what
its joints show. What one counter loses alone is in ``counter_gaps``.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from arm_model.effects.sensing import DROPPED_TRIGGER
from daq.recording import Recording
from diagnosis.cause import Estimate, LostRows
from diagnosis.residual.noise.channels import resolution
from diagnosis.screening.angle_jumps import Jump, jumps_of, turned_per_row
from diagnosis.screening.event import Event
from diagnosis.screening.lost_rows.counter_gaps import CounterGap, rows_lost

STEPS_OFF = 3.0
"""Steps of the encoder by which a jump may differ from the turn in the missing rows."""
OFF = 0.2
"""Share of that turn by which it may differ, as joints accelerate."""

Instant = tuple[int, int]
"""Row after a loss, and the number of rows that are missing before it."""


def missing_rows(recordings: Sequence[Recording]) -> list[list[Instant]]:
    """Rows that all counters lost in each recording, in time."""
    jumps = [[jumps_of(column, r.dt) for column in r.q.T] for r in recordings]
    common = [_common(r, of_joint) for r, of_joint in zip(recordings, jumps)]
    of_any = {instant for instants in common for instant in instants}
    for r, of_joint, instants in zip(recordings, jumps, common):
        of_one_joint = _of_one_joint(r, of_joint, of_any, bool(instants))
        instants += [instant for instant in of_one_joint if instant not in instants]
        instants.sort()
    return common


def gaps_of(instants: Sequence[Instant], joints: int, dt: float) -> tuple[CounterGap, ...]:
    """The same as rows that every counter lost; ``dt`` s between rows."""
    before = [0, *itertools.accumulate(count for _, count in instants)]
    return tuple(
        CounterGap(joint=joint, row=row, lost=count, time=(row + earlier) * dt)
        for joint in range(1, joints + 1)
        for (row, count), earlier in zip(instants, before)
    )


def event_of(missing: Sequence[Sequence[Instant]], recordings: Sequence[Recording]) -> Event:
    """Missing rows of the counters, with the parameters of the first recording that misses some."""
    instants = [(index, *instant) for index, several in enumerate(missing) for instant in several]
    index, row, count = instants[0]
    names = ", ".join(f"{recordings[k].path.name} {n} at {recordings[k].t[at]:.3f} s" for k, at, n in instants)
    period = recordings[index].dt
    return Event(
        effect=DROPPED_TRIGGER.name,
        joint=None,
        parameters=[
            Estimate("row", float(row), 1.0, "1"),
            Estimate("count", -float(count), 0.2, "1"),
            Estimate("period", period, 1e-3 * period, "s"),
        ],
        evidence="all moving angles jump at one row by their travel in a whole number of rows: these rows of "
        f"the counters are missing ({names})",
        recordings=tuple(dict.fromkeys(k for k, _, _ in instants)),
        lost_rows=tuple(
            LostRows(file=recordings[k].path.name, joint=None, row=at, time=float(recordings[k].t[at]), count=-n)
            for k, at, n in instants
        ),
    )


def _common(recording: Recording, jumps: Sequence[Sequence[Jump]]) -> list[Instant]:
    """Instants at which two joints or more jump, each by its turn in as many rows."""
    instants = []
    for row, part, jumped in _by_row(recording, jumps):
        if len(jumped) > 1 and (count := _rows(recording, jumped, part)):
            instants.append((row, count))
    return instants


def _by_row(
    recording: Recording, jumps: Sequence[Sequence[Jump]]
) -> Iterator[tuple[int, tuple[int, int], list[tuple[int, Jump]]]]:
    """Rows with jumps, in time: the row, those of the jumps before and after, and the joints (from 0) that jump."""
    rows = sorted({jump.row for of_joint in jumps for jump in of_joint})
    edges = [0, *rows, recording.q.shape[0]]
    for row, start, end in zip(rows, edges, edges[2:]):
        yield row, (start, end), [(j, jump) for j, of_joint in enumerate(jumps) for jump in of_joint if jump.row == row]


def _rows(recording: Recording, jumped: Sequence[tuple[int, Jump]], part: tuple[int, int]) -> int:
    """Rows missing at jumps of several joints at one row; 0 where they are no turns in as many rows."""
    losses = [rows_lost(recording.q[:, j], jump, part, recording.dt) for j, jump in jumped]
    if not all(count for count, _ in losses):
        return 0
    counts, stds = np.array(losses).T
    count = round(float(np.sum(counts / stds**2) / np.sum(stds**-2)))
    for j, jump in jumped:
        turned = turned_per_row(recording.q[:, j], jump.row, recording.dt)
        tolerance = OFF * count * abs(turned) + STEPS_OFF * resolution(recording.q[:, j])
        if abs(jump.size - count * turned) > tolerance:
            return 0
    return count


def _of_one_joint(
    recording: Recording, jumps: Sequence[Sequence[Jump]], elsewhere: set[Instant], lost_elsewhere: bool
) -> list[Instant]:
    """Rows missing where only one joint moved enough to jump: as in other recordings, or as elsewhere in this one.

    elsewhere: instants at which other recordings lost rows; lost_elsewhere: whether this one lost rows at another
    instant. All other joints must turn too little in the missing rows for a jump to be visible.
    """
    instants = []
    for row, part, jumped in _by_row(recording, jumps):
        if len(jumped) != 1:
            continue
        j, jump = jumped[0]
        turned = turned_per_row(recording.q[:, j], row, recording.dt)
        least = STEPS_OFF * resolution(recording.q[:, j])
        instants += [(at, lost) for at, lost in elsewhere if at == row and abs(jump.size - lost * turned) < least]
        count, _ = rows_lost(recording.q[:, j], jump, part, recording.dt) if lost_elsewhere else (0, 0.0)
        if count and all(_too_slow(recording, k, row, count) for k in range(recording.joints) if k != j):
            instants.append((row, count))
    return list(dict(instants).items())


def _too_slow(recording: Recording, j: int, row: int, count: int) -> bool:
    """Whether a joint turns too little in so many rows for a jump of it to be seen."""
    q = recording.q[:, j]
    return abs(count * turned_per_row(q, row, recording.dt)) < 2 * STEPS_OFF * resolution(q)
