"""Another law with a next-order term of its own in the place of a cause: the nearest single law need not be the law."""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import replace

from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.refinement import refined
from diagnosis.measurements.currents.replacement.best_sets import coefficients_of
from diagnosis.measurements.currents.state import State
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.next_order import next_orders, of_last_term


def near_case_with_term(state: State, cause: Candidate, near: Candidate) -> State | None:
    """The state with a near case of a cause and a term of its law, if its squared held-out residual is smaller.

    Of fewer coefficients, if that of all recordings is: a law that fits them better with less has no need of more.
    """
    if near.effect not in cause.definition.near_cases or not near.definition.terms:
        return None
    trial = _with_term(state, cause, near)
    of_trial = [c for c in trial.chosen if c.key == near.key]
    fewer = coefficients_of(of_trial, state.model) < coefficients_of([cause], state.model)

    def left(one: State) -> float:
        return sum(one.energy) if fewer else one.energy.held_out

    return _exact_below(left(state), trial, left)


def rival_with_term(state: State, joints: Set[int]) -> State | None:
    """The state with a rival, and a term of its law, in the place of a cause of one of the ``joints``.

    The best of those with which what is left falls to ``LIMITS.swapped`` of it. None where none does.
    """
    best, least = None, LIMITS.swapped * sum(state.energy)
    for c in (one for one in state.chosen if one.joint in joints):
        for rival in (one.candidate for one in state.rivals[c.key] if one.candidate.definition.terms):
            if rival.key in state.model.taken(state):
                continue
            found = _exact_below(least, _with_term(state, c, rival), lambda one: sum(one.energy))
            if found is not None:
                best, least = found, sum(found.energy)
    return best


def _with_term(state: State, cause: Candidate, rival: Candidate) -> State:
    """The state with a rival in the place of a cause, and the first next-order term of it that is admissible."""
    model, place = state.model, state.chosen.index(cause)
    others = model.without(cause, state).fitted
    sharp = refined(rival, others, model.data.fit)
    trial = replace(state.replaced(cause, sharp), rivals={**state.rivals, rival.key: ()})
    for extended in next_orders(sharp, trial.coefficients[place], model.seconds):
        own = of_last_term(model.columns(extended))
        if model.admissible(model.scored(extended, own, trial), trial):
            return trial.replaced(sharp, refined(extended, others, model.data.fit))
    return trial


def _exact_below(limit: float, trial: State, left: Callable[[State], float]) -> State | None:
    """The trial by the exact model, if it leaves less than the limit; first, if it does so by first-order columns."""
    if left(trial) >= limit:
        return None
    exact = trial.model.refitted(trial.chosen, trial.rivals)
    return exact if left(exact) < limit else None
