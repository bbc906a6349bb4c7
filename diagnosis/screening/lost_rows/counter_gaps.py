"""Rows that the counter of one joint lost while all other channels went on, once or several times in a recording.

At each loss the angle jumps by what the joint turned in the lost rows, and from there on every angle of this joint
belongs to a later row. Counts that an encoder missed jump as well, but leave a constant offset. Both are put right, and
the one that leaves less of the residual current is named: after lost rows, a constant offset is wrong at every other
speed. Where a jump leaves the number of rows open, the current shows it (``counter_lag``). A loss while the joint
hardly moves makes no jump; it is not found.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from arm_io.types import Array
from arm_model.effects.sensing import DROPPED_TRIGGER
from daq.recording import Recording
from diagnosis.cause import Estimate, LostRows
from diagnosis.residual.comparable_rows import comparable_rows, rms_where
from diagnosis.residual.noise.channels import resolution
from diagnosis.residual.run import Run
from diagnosis.screening.angle_jumps import Jump, jumps_of, rows_near, turned_per_row
from diagnosis.screening.event import Event, Gain
from diagnosis.screening.lost_rows.counter_lag import lost_by_current, shifts_tried
from diagnosis.screening.lost_rows.lag_path import PIECE
from diagnosis.screening.lost_rows.unmeasured_rows import NO_WEIGHT, without_weight

LONGEST = 0.5
"""s: longest loss that one jump is taken for."""
WINDOW = (50, 2.0)
"""Rows before and after a loss that a polynomial is fitted to: at least so many, and so many times those lost."""
DEGREES = (0.25, 3, 5)
"""Degree of the polynomial over a span of at most so many s, and over longer ones."""
MISFIT = 9.0
"""Rows over which a misfit of the polynomial is correlated."""
SHARE = 0.5
"""Of the guessed number of rows by which the number may differ from it."""
SURE = 0.4
"""Rows: std of the number that a jump shows, up to which it stands."""
FIXED = 0.02
"""Rows: std by which a number that stands is held."""
LEAST_STD = 0.1
"""Rows: least standard deviation of the number that a jump shows."""
SKEW = 0.01
"""s by which the currents may be early or late throughout."""
NEIGHBOURS = 30
"""Rows beside a gap that a parabola is fitted to."""
BETTER = 0.9
"""Squared residual with lost rows over that with missed counts, above which nothing decides for lost rows."""


@dataclass(frozen=True, kw_only=True)
class CounterGap:
    """Rows that the counter of a joint (from 1) lost in one recording.

    row    of the recorded column: the first after the loss
    lost   number of rows
    time   s of the first lost row, by the other channels
    std    of ``lost``
    """

    joint: int
    row: int
    lost: int
    time: float
    std: float = 0.0


Residual = Callable[[Array], Run]
"""The residual of a recording with these angles (m, n) in the place of its own."""


def counter_gaps(q: Array, dt: float, residual: Residual) -> list[CounterGap]:
    """Rows that single counters lost, in time; q (m, n) rad as recorded, every ``dt`` s."""
    jumps = [jumps_of(column, dt) for column in q.T]
    rows = [jump.row for of_joint in jumps for jump in of_joint]
    alone = [[jump for jump in of_joint if rows.count(jump.row) == 1] for of_joint in jumps]
    found: list[CounterGap] = []
    for joint, of_joint in enumerate(alone, 1):
        gaps = _gaps(joint, q[:, joint - 1], of_joint, dt)
        if gaps and _explained(q, gaps, of_joint, residual):
            found += _counted(q, gaps, dt, residual)
    return sorted(found, key=lambda gap: gap.time)


def event_of(
    gaps: Sequence[Sequence[CounterGap]], recordings: Sequence[Recording], residual: Callable[[int, Array], Run]
) -> Event:
    """The losses of all recordings as one event; ``residual`` of a recording (by its index) with angles (m, n)."""
    shown = [k for k, several in enumerate(gaps) if several]
    parameters: dict[int, list[Estimate]] = {}
    places, lost_rows = [], []
    for k in shown:
        name, dt = recordings[k].path.name, recordings[k].dt
        for gap in gaps[k]:
            parameters.setdefault(
                gap.joint,
                [
                    Estimate("row", float(gap.row), 1.0, "1"),
                    Estimate("count", -float(gap.lost), max(gap.std, LEAST_STD), "1"),
                    Estimate("period", dt, 1e-3 * dt, "s"),
                ],
            )
            places.append(f"joint {gap.joint}: {gap.lost} before row {gap.row} ({gap.time:.3f} s) of {name}")
            lost_rows.append(LostRows(file=name, joint=gap.joint, row=gap.row, time=gap.time, count=-gap.lost))
    first = gaps[shown[0]]
    joint = first[0].joint
    q = recordings[shown[0]].q
    rms = [
        rms_where(run.residual, comparable_rows(run))[joint - 1]
        for run in (residual(shown[0], q), residual(shown[0], put_back(q, first)))
    ]
    return Event(
        effect=DROPPED_TRIGGER.name,
        joint=None,
        parameters=parameters[joint],
        evidence="the counter of one joint lost rows while all other channels continued: its angle jumps by the travel "
        f"in these rows, and from there on belongs to later rows ({'; '.join(places)})",
        recordings=tuple(shown),
        gain=Gain(before=float(rms[0]), after=float(rms[1]), unit="A", joint=joint),
        of_joints=parameters,
        lost_rows=tuple(lost_rows),
    )


def put_back(q: Array, gaps: Sequence[CounterGap]) -> Array:
    """(m, n) angles with the lost rows interpolated; as many at the end of these columns are extrapolated."""
    q = q.copy()
    for joint, several in itertools.groupby(sorted(gaps, key=lambda gap: (gap.joint, gap.row)), lambda gap: gap.joint):
        q[:, joint - 1] = _restored(q[:, joint - 1], [(gap.row, gap.lost) for gap in several])
    return q


def without_lost(run: Run, gaps: Sequence[CounterGap], dt: float) -> Run:
    """A run in which rows that a counter lost weigh nothing, nor the end, where its angles are extrapolated."""
    end, lost = float(run.t[-1]), Counter[int]()
    for gap in gaps:
        lost[gap.joint] += gap.lost
    spans = [(gap.time, gap.time + gap.lost * dt) for gap in gaps]
    return without_weight(run, [*spans, *((end - rows * dt, end) for rows in lost.values())])


def _gaps(joint: int, q: Array, jumps: Sequence[Jump], dt: float) -> list[CounterGap]:
    """The jumps of one angle (m,) as lost rows; those against the motion are none."""
    edges = [0, *(jump.row for jump in jumps), len(q)]
    gaps, before = [], 0
    for jump, start, end in zip(jumps, edges, edges[2:]):
        lost, std = rows_lost(q, jump, (start, end), dt)
        if lost:
            gaps.append(CounterGap(joint=joint, row=jump.row, lost=lost, time=(jump.row + before) * dt, std=std))
            before += lost
    return gaps


def rows_lost(q: Array, jump: Jump, part: tuple[int, int], dt: float) -> tuple[int, float]:
    """Number of rows lost at a jump, and its std: with that many rows between them, one polynomial fits both sides.

    0 for a jump that the motion does not explain.
    """
    row, turned = jump.row, turned_per_row(q, jump.row, dt)
    if abs(turned) * rows_near(dt) < resolution(q) or not 0.5 < jump.size / turned < LONGEST / dt:
        return 0, 0.0
    guess = jump.size / turned
    reach = max(WINDOW[0], round(WINDOW[1] * guess))
    before, after = np.arange(max(part[0], row - reach), row), np.arange(row, min(part[1], row + reach))
    degree = DEGREES[1] if 2 * reach * dt <= DEGREES[0] else DEGREES[2]
    values = np.concatenate([q[before], q[after]])
    tried = np.arange(max(1, round((1 - SHARE) * guess) - 1), round((1 + SHARE) * guess) + 2)
    errors = np.empty(len(tried))
    for k, lost in enumerate(tried):
        columns = np.vander((np.concatenate([before, after + lost]) - row) / reach, degree + 1)
        errors[k] = np.sum((values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]) ** 2)
    best = int(np.argmin(errors))
    variance = max(float(errors[best]) / len(values), resolution(q) ** 2 / 12)
    likely = np.exp(-(errors - errors[best]) / (2 * MISFIT * variance))
    std = np.sqrt(np.sum(likely * (tried - tried[best]) ** 2) / np.sum(likely))
    return int(tried[best]), max(float(std), LEAST_STD)


def _counted(q: Array, gaps: Sequence[CounterGap], dt: float, residual: Residual) -> list[CounterGap]:
    """The gaps of one joint, with numbers of rows that its current shows where the jumps leave them open."""
    if all(gap.std <= SURE for gap in gaps):
        return list(gaps)
    joint, angles = gaps[0].joint, put_back(q, gaps)
    doubt = round(3.0 * float(np.sqrt(sum(gap.std**2 for gap in gaps))) + SKEW / dt)
    runs = {rows: residual(_delayed(angles, joint, rows)) for rows in shifts_tried(doubt, dt)}
    by_current = lost_by_current(runs, joint, [(gap.time, gap.std if gap.std > SURE else FIXED) for gap in gaps])
    counted, before = [], 0
    for gap, (rows, std) in zip(gaps, by_current):
        lost = gap.lost + rows
        if lost > 0:
            best_std = gap.std if gap.std <= SURE else std
            counted.append(replace(gap, lost=lost, std=best_std, time=(gap.row + before) * dt))
            before += lost
    return counted


def _delayed(q: Array, joint: int, rows: int) -> Array:
    """Angles (m, n), those of one joint later by ``rows``."""
    q = q.copy()
    q[:, joint - 1] = q[np.clip(np.arange(len(q)) - rows, 0, len(q) - 1), joint - 1]
    return q


def _explained(q: Array, gaps: Sequence[CounterGap], jumps: Sequence[Jump], residual: Residual) -> bool:
    """Whether lost rows leave less of the residual current than counts missed at the same rows."""
    counted = q.copy()
    for jump in jumps:
        if jump.row in {gap.row for gap in gaps}:
            counted[jump.row :, gaps[0].joint - 1] -= jump.size
    with_rows, with_counts = residual(put_back(q, gaps)), residual(counted)
    dt = float(with_rows.raw[0][1] - with_rows.raw[0][0])
    weighted = [without_lost(run, gaps, dt) for run in (with_rows, with_counts)]
    # rows that both can judge, without the mean of each piece: loads that the model has not are no lost rows
    joint = gaps[0].joint - 1
    rows = np.flatnonzero((weighted[0].deviation < NO_WEIGHT * 1e-3).all(axis=1))
    pieces = [rows[at : at + PIECE] for at in range(0, len(rows) - PIECE + 1, PIECE)]
    variance = [float(sum(np.var(run.residual[piece, joint]) for piece in pieces)) for run in weighted]
    return variance[0] < BETTER * variance[1]


def _restored(q: Array, gaps: Sequence[tuple[int, int]]) -> Array:
    """One angle (m,) with ``gaps`` (row, rows lost) filled; cut to its length, its end extrapolated."""
    lost = sum(count for _, count in gaps)
    edges = [0, *(row for row, _ in gaps), len(q)]
    shifts = np.cumsum([0, *(count for _, count in gaps)])
    places = np.concatenate([np.arange(a, b) + shift for a, b, shift in zip(edges, edges[1:], shifts)])
    filled = np.empty(len(q) + lost)
    filled[places] = q
    for (row, count), shift in zip(gaps, shifts):
        start = row + int(shift)
        slopes = [_slope(q[max(row - NEIGHBOURS, 0) : row])[-1], _slope(q[row : row + NEIGHBOURS])[0]]
        ends = (start - 1, start + count)
        filled[start : start + count] = CubicHermiteSpline(ends, (q[row - 1], q[row]), slopes)(
            np.arange(start, start + count)
        )
    return filled[: len(q)]


def _slope(q: Array) -> Array:
    """(m,) rad per row: slope of the parabola through angles (m,)."""
    rows = np.arange(len(q))
    return np.asarray(np.polyval(np.polyder(np.polyfit(rows, q, 2)), rows))
