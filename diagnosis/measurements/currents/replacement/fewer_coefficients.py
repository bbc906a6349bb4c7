"""A rival of fewer coefficients in the place of a cause of many, if it predicts as well beside all others.

Forward selection compares columns, which are first order in their effects. Many coefficients follow what another law
has beyond that, so that its exact law is asked here.
"""

from __future__ import annotations

import numpy as np

from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.replacement.trial import clearly_worse
from diagnosis.measurements.currents.state import State

SEVERAL = 4
"""Coefficients from which on a cause may have followed another effect that was missing when it was chosen."""


def fewer_coefficients(state: State) -> State:
    """The state with rivals of fewer coefficients in the place of causes of ``SEVERAL``, if they predict as well.

    While another effect was missing, the ten coefficients of a link followed some of it, and it gained more than the
    payload of four that was there.
    """
    model = state.model
    for c in state.chosen:
        coefficients = state.coefficients[state.chosen.index(c)]
        if np.count_nonzero(coefficients) < SEVERAL or c.terms:
            continue
        gain = model.without(c, state).energy.held_out - state.energy.held_out
        trials: list[tuple[float, State]] = []
        for rival in model.nearly_rivals_of(c, state):
            fewer = int(np.count_nonzero(coefficients)) - rival.determined
            if fewer <= 0 or rival.candidate.terms:
                continue
            chosen = [rival.candidate if one is c else one for one in state.chosen]
            own = [one for one in state.rivals.get(c.key, ()) if one.candidate.key != rival.candidate.key]
            trial = model.refitted(chosen, {**state.rivals, rival.candidate.key: own})
            tolerance = max(LIMITS.tie * gain * fewer, LIMITS.tie_floor * state.data.held_out.rows)
            more = trial.energy.held_out - state.energy.held_out
            worse = any(clearly_worse(trial, state, joint) for joint in range(1, len(model.arm) + 1))
            if more < tolerance and not worse:
                trials.append((more - tolerance, trial))
        state = min(trials, key=lambda one: one[0], default=(0.0, state))[1]
    return state
