"""Two effects in the place of a law of many coefficients whose special cases imitate them together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.replacement.best_sets import best_sets
from diagnosis.measurements.currents.replacement.fewer_coefficients import SEVERAL
from diagnosis.measurements.currents.replacement.special_cases import are_separate
from diagnosis.measurements.currents.replacement.trial import (
    followed,
    predicts_more,
    residual_energy,
    tenable,
    with_added,
    with_rivals,
)
from diagnosis.measurements.currents.state import State
from diagnosis.selection.candidate import Candidate
from identification.selection import Split


def two_for_one(state: State) -> State:
    """The state with two effects in the place of laws of ``SEVERAL`` coefficients that have parts, if these have fewer.

    An offset and a torque constant are followed by level and slope of friction in either direction. The two are named
    if they explain as much as the law, and more than any two parts of it: of a law that is there, two parts are nearer
    than effects that it is none of. Two parts themselves are named if they are separate causes, and explain more than
    other parts; one of them alone if the other is within what the model is known to.
    """
    model = state.model
    for c in state.chosen:
        determined = int(np.count_nonzero(state.coefficients[state.chosen.index(c)]))
        if c.joint is None or c.terms or determined < SEVERAL or not c.definition.special_cases:
            continue
        kept = tuple(one for one in state.chosen if one is not c)
        without = model.refitted(kept, state.rivals)
        of_parts = [one for one in model.library if one.joint == c.joint and one.effect in c.definition.special_cases]
        parts = {both: with_added(both, without) for both in itertools.combinations(of_parts, 2)}
        most = _no_worse(state, c.joint, state.data.map(lambda part: LIMITS.tie_floor * part.rows))
        trials = {some: with_added(some, without) for some in best_sets(without, c.joint, determined - 1, most.fit)}
        allowed = [
            both
            for both in parts
            if are_separate(both, c.definition) and not {one.key for one in both} & model.excluded
        ]
        trials |= {both: parts[both] for both in allowed}
        most_of_parts = _no_worse(state, c.joint, followed(state, LIMITS.tie_floor))
        better = [
            found
            for some, trial in trials.items()
            if _leaves(trial, c.joint, most_of_parts if some in allowed else most)
            and not predicts_more(state, trial)
            and all(predicts_more(trial, one) for both, one in parts.items() if both != some)
            and (found := _tenable_of(some, trial, without, parts=some in allowed)) is not None
        ]
        if better:
            state = with_rivals(min(better, key=lambda trial: sum(trial.energy)), kept)
    return state


def _no_worse(state: State, joint: int, by: Split[float]) -> Split[float]:
    """Energies that a trial may leave: of the fitted rows of a joint, and of all held-out rows."""
    return replace(by, fit=residual_energy(state, joint) + by.fit, held_out=state.energy.held_out + by.held_out)


def _leaves(trial: State, joint: int, most: Split[float]) -> bool:
    """Whether a trial leaves less than ``most`` (``_no_worse``)."""
    return trial.energy.held_out < most.held_out and residual_energy(trial, joint) < most.fit


def _tenable_of(some: Sequence[Candidate], trial: State, without: State, *, parts: bool) -> State | None:
    """The trial if these of its candidates are tenable; of ``parts``, that with those that are; None where none is.

    What the other part of a law explains is then what the parameters of the model may be wrong by.
    """
    are_tenable = tuple(c for c in some if tenable(c, trial))
    if len(are_tenable) == len(some):
        return trial
    alone = with_added(are_tenable, without) if parts and are_tenable else None
    return alone if alone is not None and all(tenable(c, alone) for c in are_tenable) else None
