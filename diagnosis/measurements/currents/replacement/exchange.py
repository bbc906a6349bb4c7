"""One or two effects in the place of one or two causes of a joint, where a search ends above the noise.

Forward selection takes the law that predicts held-out rows best. Where these hardly move a joint, or move it in one
way, a law of several coefficients does as well there as two effects that it is none of, and hides both of them. So
others take the place of causes if they have no more coefficients, predict held-out rows as well, and leave at most half
of what the causes leave of the fitted rows: with no more coefficients, that is not by chance.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.replacement.best_sets import best_sets, coefficients_of
from diagnosis.measurements.currents.replacement.trial import residual_energy, tenable, with_added, with_rivals
from diagnosis.measurements.currents.state import State
from diagnosis.selection.candidate import Candidate


def exchanged(state: State) -> State | None:
    """The state with other causes at a joint; None where none are clearly better."""
    for joint in sorted({c.joint for c in state.chosen if c.joint is not None}):
        if residual_energy(state, joint) < state.data.fit.rows:
            continue  # no more than noise
        own = [c for c in state.chosen if c.joint == joint]
        for some in (*itertools.combinations(own, 1), *itertools.combinations(own, 2)):
            plain = not any(c.body or c.terms for c in some)
            if plain and (better := _in_place_of(some, joint, state)) is not None:
                return better
    return None


def _in_place_of(replaced: Sequence[Candidate], joint: int, state: State) -> State | None:
    """The state with the best other effects in the place of these causes of a joint; None where none are better."""
    model, kept = state.model, tuple(c for c in state.chosen if c not in replaced)
    determined = dict(zip(state.chosen, map(np.count_nonzero, state.coefficients)))
    most = sum(int(determined[c]) + len(c.searched()) for c in replaced)
    without, enough = model.refitted(kept, state.rivals), LIMITS.swapped * residual_energy(state, joint)
    gain, rows = without.energy.held_out - state.energy.held_out, state.data.held_out.rows
    found: list[State] = []
    for others in best_sets(without, joint, most, enough):
        trial = with_added(others, without)
        tolerance = max(LIMITS.tie * gain * max(1, most - coefficients_of(others, model)), LIMITS.tie_floor * rows)
        as_well = trial.energy.held_out < state.energy.held_out + tolerance
        if as_well and residual_energy(trial, joint) < enough and all(tenable(c, trial) for c in others):
            found.append(trial)
    if not found:
        return None
    return with_rivals(min(found, key=lambda trial: sum(trial.energy)), kept)
