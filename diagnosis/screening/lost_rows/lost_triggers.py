"""Triggers that one group of channels dropped: from one row on, currents belong to later rows, and their lag changes.

A constant lag is time skew and remains. A lag that changes at one instant by whole rows, equally at all joints that
determine it, is dropped triggers. There may be several, of any length: long ones show in the path of lags
(``lag_path``), short ones in the first-order effect of a lag on the residual (``lag_change``), several of both in the
lags of all rows (``lag_by_rows``).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows.common_count import PLACED, WHOLE, CommonCount, common_count
from diagnosis.screening.lost_rows.lag_by_rows import RowStep, steps_by_rows
from diagnosis.screening.lost_rows.lag_change import Change, change_at, change_of_lag, instant_of, mean_lag, part_of
from diagnosis.screening.lost_rows.lag_path import Step, instant, lag_steps, put_back, worth_looking
from diagnosis.screening.lost_rows.losses import DroppedTriggers
from diagnosis.screening.lost_rows.unmeasured_rows import NO_WEIGHT, without_weight

SIGNIFICANT_STDS = 7.0
"""Std of a short change that it must exceed: it is the largest of all instants, in data with other errors."""
CANDIDATE_STDS = 3.0
"""Std of it before the currents are put back: of more than some 10 ms, the first-order effect shows every joint another
part, by how abruptly its current changes, and the joints agree only once they are put back."""
REFINEMENTS = 8
"""Times that a change is estimated again, at most."""
CONVERGED = 0.1
"""Share of its std by which the last estimate may move a change."""
FIRST_ORDER = 0.02
"""s of a change up to which the first-order effect of a lag shows its instant."""
MOST_ROWS = 12
"""Rows of a change that is judged by several recordings together, by its first-order effect."""
WEIGHTED = 1e-3 * NO_WEIGHT
"""Times the median std of a joint, above which a row has no weight."""
NEAR = 0.25
"""s before and after a long loss in which no short one is looked for."""


def dropped_triggers(runs: Sequence[Run], periods: Sequence[float]) -> list[DroppedTriggers]:
    """Triggers that recordings dropped, in time; ``periods`` s between the rows of each recording.

    What one recording does not determine alone is judged by all that lost at most a few rows (``common_count``).
    """
    of_each = [_of_recording(k, run, period) for k, (run, period) in enumerate(zip(runs, periods))]
    few = [k for k, own in enumerate(of_each) if len(own) < 2 and all(abs(loss.count) <= MOST_ROWS for loss in own)]
    shown = max((abs(loss.count) for k in few for loss in of_each[k]), default=0)
    common = common_count([runs[k] for k in few], [periods[k] for k in few], shown)
    for index, (time, time_std) in common.instants.items() if common else ():
        k, period = few[index], periods[few[index]]
        if common and all(_less_certain(loss, common) for loss in of_each[k]):
            row, row_std = round(time / period), time_std / period
            of_each[k] = [DroppedTriggers(k, row, row_std, common.count, common.count_std, period)]
    return [loss for losses in of_each for loss in losses]


def _less_certain(loss: DroppedTriggers, common: CommonCount) -> bool:
    """Whether a recording by itself shows a number that may be the common one, and shows it less surely."""
    return abs(loss.count - common.count) <= 2.0 * loss.count_std and loss.count_std > common.count_std


def _of_recording(index: int, run: Run, period: float) -> list[DroppedTriggers]:
    """The losses of a recording by its lags piece by piece, row by row, and by their first-order effect.

    Those are taken that leave least. Another error chooses a lag of its own in some pieces of a path; it must not hide
    a change of some rows.
    """
    paths = [steps for steps in lag_steps(run) if energy(_aligned(run, steps)[0]) < energy(run)]
    found = [_beside_steps(index, run, steps, period) for steps in (*paths, [])]
    if worth_looking(run):
        about = {0.0, *(lag for steps in paths for lag in itertools.accumulate(step.step for step in steps))}
        by_rows = steps_by_rows(run, period, sorted(about))
        if losses := _by_rows(index, by_rows, period):
            found += [losses, _beside_steps(index, run, by_rows, period)]
    several = [losses for losses in found if losses]
    return min(several, key=lambda losses: energy(_aligned(run, _steps_of(losses))[0]), default=[])


def _by_rows(index: int, steps: Sequence[RowStep], period: float) -> list[DroppedTriggers]:
    """The losses of a recording by its lags row by row; none where none of them is for certain a whole number of rows.

    Beside one that is, others are known less: what has lost rows loses them again.
    """
    if not any(abs(step.step) > FIRST_ORDER or _whole(step.step / period, step.step_std / period) for step in steps):
        return []
    losses, shift = list[DroppedTriggers](), 0.0
    for step in steps:
        count = round(step.step / period)
        count_std = max(step.step_std / period, abs(step.step / period - count), 0.05)
        row = round((step.time + shift) / period)
        losses.append(DroppedTriggers(index, row, step.time_std / period, count, count_std, period))
        shift += count * period
    return losses


def _whole(rows: float, std: float) -> bool:
    """Whether a number of rows is for certain a whole one."""
    return std <= WHOLE and abs(rows - round(rows)) <= WHOLE


def _beside_steps(index: int, run: Run, steps: Sequence[Step], period: float) -> list[DroppedTriggers]:
    """The losses of a recording by these steps of its path, refined, and those in between that are too short for it."""
    aligned, places = _aligned(run, steps)
    edges = [-np.inf, *places, np.inf]
    splits = [time for a, b in itertools.pairwise(edges) for time in _splits(part_of(aligned, a + NEAR, b - NEAR))]
    times = sorted([*places, *splits])
    losses = []
    for before, time, after in zip([-np.inf, *times], times, [*times[1:], np.inf]):
        part = part_of(aligned, before, after)
        change = change_at(part, time)
        refined = None if change is None else _refined(part, change)
        if time in places:
            losses += _long(index, (run, part), (steps, places.index(time)), refined, period)
        elif refined is not None:
            losses += _short(index, part, refined, period)
    return losses


def _steps_of(losses: Sequence[DroppedTriggers]) -> list[Step]:
    """The losses of one recording, in time, as steps among its currents."""
    sizes = [loss.count * loss.period for loss in losses]
    shifts = itertools.accumulate(sizes[:-1], initial=0.0)
    return [Step(loss.row * loss.period - shift, size) for loss, size, shift in zip(losses, sizes, shifts)]


def _refined(run: Run, change: Change) -> Change:
    """The change estimated again with the currents put back by it: the effect of a lag is of first order only."""
    skew = mean_lag(part_of(run, -np.inf, change.time))
    for _ in range(REFINEMENTS):
        steps = [Step(-np.inf, -skew), Step(change.time, -change.step)]
        current, rate = put_back(run.current, run.t, steps), put_back(run.current_rate, run.t, steps)
        aligned = replace(run, current=current, current_rate=rate)
        remaining = change_at(aligned, change.time)
        if remaining is None:
            break
        change = replace(remaining, step=change.step + remaining.step)
        if abs(remaining.step) < CONVERGED * remaining.std:
            break
    return change


def _short(index: int, run: Run, change: Change, period: float) -> list[DroppedTriggers]:
    """A change of a few rows; nothing where it is not a whole number of them.

    Of a long one at a high rate, a fraction of a row is not known; what changes a lag by that much at an instant are
    lost rows in any case. Its instant is that of whole lags: of these the first-order effect shows none.
    """
    long = abs(change.step) > FIRST_ORDER
    if abs(change.step) < SIGNIFICANT_STDS * change.std or (change.std > WHOLE * period and not long):
        return []
    rows = -change.step / period
    count = round(rows)
    misfit = abs(rows - count)
    if count == 0 or misfit > max(WHOLE, change.std / period):
        return []
    if long:
        skew = -mean_lag(part_of(run, -np.inf, change.time))
        time, time_std = instant(run, (skew, skew + count * period), (run.t[0], run.t[-1] - abs(count) * period))
    else:
        time, time_std = instant_of(run, replace(change, step=-count * period))
    if time_std > PLACED:
        return []
    row, count_std = round(time / period), max(change.std / period, misfit, 0.05)
    return [DroppedTriggers(index, row, time_std / period, count, count_std, period)]


def _long(
    index: int, runs: tuple[Run, Run], which: tuple[Sequence[Step], int], change: Change | None, period: float
) -> list[DroppedTriggers]:
    """A change of many rows: the step of the path, refined by what is left of it after the currents were put back.

    runs: as recorded, and put back around the change; which: all steps of the path, and the one.
    """
    run, aligned = runs
    steps, k = which
    half = 0.5 / run.per_second
    certain = change is not None and change.std < half and abs(change.step) < 2.0 * half
    remaining, std = (change.step, change.std) if change is not None and certain else (0.0, half)
    count = round((steps[k].step - remaining) / period)
    if count == 0:
        return []
    shift = sum(earlier.step for earlier in steps[:k])
    skew = -mean_lag(part_of(aligned, -np.inf, steps[k].time + shift))
    lags = shift + skew, shift + skew + count * period
    edges = [0.0, *(step.time for step in steps), np.inf]
    near = edges[k], min(edges[k + 2], run.t[-1] - abs(lags[1]))
    if not np.any((run.t >= near[0]) & (run.t < near[1])):
        # a step at the very end, without rows after it
        return []
    time, time_std = instant(run, lags, near)
    if time_std > PLACED:
        return []
    row = round((time + shift) / period)
    return [DroppedTriggers(index, row, time_std / period, count, max(std / period, 0.05), period)]


def _aligned(run: Run, steps: Sequence[Step]) -> tuple[Run, list[float]]:
    """The run with its currents put back, and the times of the steps among the angles, s.

    Rows that were not measured have no weight, nor what filters smear of them.
    """
    if not steps:
        return run, []
    shifts = [0.0, *itertools.accumulate(step.step for step in steps)]
    times = [step.time + shift for step, shift in zip(steps, shifts)]
    rate, end = put_back(run.current_rate, run.t, steps), float(run.t[-1])
    spans = [(time, time + max(step.step, 0.0)) for time, step in zip(times, steps)]
    if shifts[-1] < 0.0:
        spans.append((end + shifts[-1], end))
    return without_weight(replace(run, current=put_back(run.current, run.t, steps), current_rate=rate), spans), times


def _splits(run: Run) -> list[float]:
    """Times of the changes of lag, s: the most certain one, and those of the parts before and after it."""
    change = change_of_lag(run) if len(run.t) else None
    if change is None or abs(change.step) < CANDIDATE_STDS * change.std or not _sure(run, change):
        return []
    before, after = part_of(run, -np.inf, change.time), part_of(run, change.time, np.inf)
    return [*_splits(before), change.time, *_splits(after)]


def _sure(run: Run, change: Change) -> bool:
    """Whether a change is certain, at first sight or with the currents put back."""
    refined = change if abs(change.step) > SIGNIFICANT_STDS * change.std else _refined(run, change)
    return abs(refined.step) > SIGNIFICANT_STDS * refined.std


def uncounted_change(run: Run) -> Change | None:
    """The change of a run's lag that is certain, where its rows or its instant are not; None where there is none.

    At first sight, and with the currents put back by it.
    """
    change = change_of_lag(run) if len(run.t) else None
    if change is None or abs(change.step) < SIGNIFICANT_STDS * change.std:
        return None
    refined = _refined(run, change)
    return refined if abs(refined.step) > SIGNIFICANT_STDS * refined.std else None


def energy(run: Run) -> float:
    """Mean square of a run's residual over its std, at all joints, at the constant lag that fits best.

    Over the rows that have a weight. A lag that changes looks like a time skew between both lags as long as it is not
    known: such a skew must not speak against rows that were put where they belong.
    """
    y, rate = run.residual / run.deviation, run.current_rate / run.deviation
    rows = int(np.count_nonzero(run.deviation < WEIGHTED * np.median(run.deviation, axis=0)))
    size = float(np.sum(rate**2))
    return float(np.sum(y**2) - np.sum(y * rate) ** 2 / size if size > 0.0 else np.sum(y**2)) / max(rows, 1)
