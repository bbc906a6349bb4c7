"""Current limits at which nothing was clipped: the joint merely stood there, or no closed loop shows the limit.

A closed loop shows a limit by its smaller error. How a servo comes out of its limit is in few models (whether its
integrator runs on meanwhile), so that the loop with the limit may be the farther one from then on. There the loop
without it shows the limit: it gives more than the drive gave.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_model import Arm
from daq.recording import Recording
from diagnosis.cause import Cause, EffectKey, without_cause
from diagnosis.closed_loop.comparison import LoopComparison, compare
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.residual.generation import CREEP
from diagnosis.residual.run import Run
from diagnosis.selection.design import Dataset
from identification.selection import Split

AT_LIMIT = 0.97
"""Share of its limit from which on a current, filtered, is at it."""
MORE = 5.0
"""Times the usual error of a loop by which its current must exceed that of the drive."""


def idle_limits(
    causes: Sequence[Cause], extended: Arm, recordings: Split[Sequence[Recording]], data: Split[Dataset]
) -> list[EffectKey]:
    """Current limits that no closed loop shows, or, where none can, at which the joint merely stood.

    extended: the model with all ``causes``.
    """
    every = [*zip(recordings.fit, data.fit.runs), *zip(recordings.held_out, data.held_out.runs)]
    runs, keys = [run for _, run in every], list[EffectKey]()
    for cause in causes:
        if limit_of(cause) is None or cause.joint is None:
            continue
        fewer = without_cause(extended, cause)
        pairs = [(compare(r, fewer, run), compare(r, extended, run)) for r, run in every]
        compared = [(a, b) for a, b in pairs if a is not None and b is not None]
        noise = float(np.mean([run.noise[cause.joint - 1] for run in runs]))
        shown = not all(shows_nothing(cause, *pair, noise) for pair in compared)
        if not compared:
            shown = not held_at_standstill(cause, runs)
        without = [(loop, run) for (loop, _), run in zip(pairs, runs) if loop is not None]
        if not shown and not asks_for_more(cause, without, noise):
            keys.append(cause.key)
    return keys


def limit_of(cause: Cause) -> float | None:
    """A: the current at which a cause says that a joint is clipped; None for a cause of another kind."""
    return next((p.value for p in cause.parameters if p.name == "limit"), None)


def held_at_standstill(cause: Cause, runs: Sequence[Run]) -> bool:
    """Whether a joint merely stood wherever its current was at its limit: it held a load, and nothing was clipped."""
    limit = limit_of(cause)
    if limit is None or cause.joint is None:
        return False
    j = cause.joint - 1
    at_limit = [np.abs(run.current[:, j]) > AT_LIMIT * limit for run in runs]
    moving = [np.abs(run.brisk_v[:, j]) > CREEP for run in runs]
    return any(rows.any() for rows in at_limit) and not any((a & b).any() for a, b in zip(at_limit, moving))


def asks_for_more(cause: Cause, loops: Sequence[tuple[LoopComparison, Run]], noise: float) -> bool:
    """Whether loops without the limit of a joint give more than its drive, while it moves and its current is there.

    By rows of each recording, in rms, compared with the median error over the recordings. A loop that gives as much as
    the drive above the limit contradicts it. noise: A, of the residual current of the joint, below which no error is.
    """
    limit = limit_of(cause)
    if limit is None or cause.joint is None or not loops:
        return False
    j = cause.joint - 1
    usual = max(float(np.median([loop.error_rms("current")[j] for loop, _ in loops])), noise)
    for loop, run in loops:
        there = (np.abs(run.brisk_v[:, j]) > CREEP) & (np.abs(run.current[:, j]) > AT_LIMIT * limit)
        more = np.maximum(-loop.error("current")[:, j] * np.sign(run.current[:, j]), 0.0)
        if there.any() and float(np.sqrt(np.mean(more[there] ** 2))) > MORE * usual:
            return True
    return False


def shows_nothing(cause: Cause, without: LoopComparison, having: LoopComparison, noise: float) -> bool:
    """Whether a closed loop is as near to a recording without a cause of one joint as with it.

    noise: A, of the residual current of that joint.
    """
    assert cause.felt_at is not None
    before, after = (one.error_rms("current")[cause.felt_at - 1] ** 2 for one in (without, having))
    return bool(before - after < LIMITS.min_gain * noise**2)
