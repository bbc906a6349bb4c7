"""The last gate of every cause: a held-out gain that matters, with all other causes in the final model.

A cause is accepted by what it gains when it enters, while others are missing. What enters after it, or leaves, may take
that gain away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from daq.recording import Recording
from diagnosis.cause import Cause, EffectKey
from diagnosis.closed_loop.comparison import Compared, compare
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model import State
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.run import CREEP, Run, residual_under
from diagnosis.selection.beyond_model import in_deviations
from diagnosis.selection.design import Dataset
from diagnosis.selection.model_uncertainty import Significance
from identification.selection import Split

AT_LIMIT = 0.97
"""Share of its limit from which on a current, filtered, is at it."""


def negligible(state: State, causes: Sequence[Cause]) -> int | None:
    """The chosen candidate that gains least in the final model, if that does not matter; None where all matter.

    causes: the chosen ones. Each must gain twice, over all held-out rows: with the others refitted to do without it,
    and in the exact model of all, whose columns are not of the first order.
    """
    model, runs = state.model, state.data.held_out.runs
    arms = [run.arm.effects for run in runs]
    terms = [term for cause in causes for term in cause.terms]
    found: list[tuple[float, int]] = []
    full = _energy(runs, [(*own, *terms) for own in arms])
    for index, (c, cause) in enumerate(zip(state.chosen, causes, strict=True)):
        alone = model.conditional(c, model.without(c, state), state)
        others = [term for term in terms if term not in cause.terms]
        gain = float((_energy(runs, [(*own, *others) for own in arms]) - full).sum())
        least = LIMITS.min_gain * state.data.held_out.rows
        if gain < least or not model.needed(alone, state):
            found.append((min(gain, alone.gain), index))
    return min(found)[1] if found else None


def within_model(state: State) -> int | None:
    """The chosen candidate that is least beyond what is known of the model, if it is not; None where all are.

    Conditional on all others: what enters after a cause, or in a pair, may take its significance away.
    """
    model = state.model
    if model.uncertain is None or not state.chosen:
        return None
    chances = [model.without(c, state).significance.chance(model.columns(c)) for c in state.chosen]
    most = int(np.argmax(chances))
    return most if chances[most] > LIMITS.beyond_model else None


def with_significance(state: State, causes: Sequence[Cause]) -> list[Cause]:
    """The causes, of the chosen candidates in their order, with how much of their significance the model leaves."""
    model, found = state.model, []
    if model.uncertain is None:
        return list(causes)
    for c, cause in zip(state.chosen, causes, strict=True):
        others = model.without(c, state)
        exact = Significance(state.data, [*others.free, *(model.columns(one) for one in others.chosen)], None)
        chances = [of.chance(model.columns(c)) for of in (exact, others.significance)]
        found.append(replace(cause, deviations=(in_deviations(chances[0]), in_deviations(chances[1]))))
    return found


def _energy(runs: Sequence[Run], effects: Sequence[Sequence[EffectTerm]]) -> Array:
    """(n,) squared whitened residuals of the rows that are compared, under the arms of ``runs`` with these effects."""
    total = np.zeros(len(runs[0].arm))
    for run, own in zip(runs, effects):
        white = run.whiten(residual_under(run, own))
        total += np.sum(white**2 * comparable_rows(run), axis=0)
    return total


def idle_limits(
    causes: Sequence[Cause], extended: Arm, recordings: Split[Sequence[Recording]], data: Split[Dataset]
) -> list[EffectKey]:
    """Current limits that no closed loop shows, or, where none can, at which the joint merely stood.

    extended: the model with all ``causes``.
    """
    every, runs, idle = [*recordings.fit, *recordings.held_out], [run for part in data for run in part.runs], []
    for cause in causes:
        if limit_of(cause) is None or cause.joint is None:
            continue
        without = replace(extended, effects=tuple(term for term in extended.effects if term not in cause.terms))
        pairs = [(compare(r, without, run), compare(r, extended, run)) for r, run in zip(every, runs)]
        both = [(a, b) for a, b in pairs if a is not None and b is not None]
        noise = float(np.mean([run.noise[cause.joint - 1] for run in runs]))
        if all(shows_nothing(cause, a, b, noise) for a, b in both) if both else stood(cause, runs):
            idle.append(cause.key)
    return idle


def limit_of(cause: Cause) -> float | None:
    """A: the current at which a cause says that a joint is clipped; None for a cause of another kind."""
    return next((p.value for p in cause.parameters if p.name == "limit"), None)


def stood(cause: Cause, runs: Sequence[Run]) -> bool:
    """Whether a joint merely stood wherever its current was at its limit: it held a load, and nothing was clipped."""
    limit = limit_of(cause)
    if limit is None or cause.joint is None:
        return False
    j = cause.joint - 1
    at_limit = [np.abs(run.current[:, j]) > AT_LIMIT * limit for run in runs]
    moving = [np.abs(run.brisk_v[:, j]) > CREEP for run in runs]
    return any(here.any() for here in at_limit) and not any((a & b).any() for a, b in zip(at_limit, moving))


def shows_nothing(cause: Cause, without: Compared, having: Compared, noise: float) -> bool:
    """Whether a closed loop is as near to a recording without a cause of one joint as with it.

    noise: A, of the residual current of that joint.
    """
    assert cause.felt_at is not None
    before, after = (one.error_rms("current")[cause.felt_at - 1] ** 2 for one in (without, having))
    return bool(before - after < LIMITS.min_gain * noise**2)
