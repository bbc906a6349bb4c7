"""A state with other candidates, and what it leaves: what the rules of replacement try and compare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.state import State
from diagnosis.selection.candidate import Candidate
from identification.selection import Split, p_value


def with_added(some: Sequence[Candidate], state: State) -> State:
    """The state with further candidates, their rivals still unknown."""
    return state.model.refitted((*state.chosen, *some), {**state.rivals, **{c.key: () for c in some}})


def with_rivals(state: State, kept: Sequence[Candidate]) -> State:
    """The state with the rivals of those of its candidates that are not among the ``kept``."""
    new = [c for c in state.chosen if c not in kept]
    return replace(state, rivals={**state.rivals, **{c.key: state.model.rivals_of(c, state) for c in new}})


def residual_energy(state: State, joint: int) -> float:
    """Squared residual of the fitted rows of a joint, in units of the noise variance."""
    return float(np.sum(state.residual.fit[state.data.fit.of(joint)] ** 2))


def followed(state: State, floor: float) -> Split[float]:
    """Energies that more coefficients of friction may take by following what no effect explains.

    floor: share of the noise energy that they may take in any case.
    """
    follows, joints = LIMITS.follows, len(state.model.arm)

    def of(energy: float, rows: int) -> float:
        return max(floor * rows, follows * (energy - rows * joints))

    data, energy = state.data, state.energy
    return replace(energy, fit=of(energy.fit, data.fit.rows), held_out=of(energy.held_out, data.held_out.rows))


def predicts_more(state: State, other: State) -> bool:
    """Whether a state predicts held-out rows better than another by more than blocks differ by chance."""
    fall = other.residual.held_out**2 - state.residual.held_out**2
    return p_value(state.data.held_out.by_block(fall)) < LIMITS.ambiguity_p


def clearly_worse(trial: State, state: State, joint: int | None) -> bool:
    """Whether a trial leaves so much of the fitted rows of a joint that ``exchanged`` would take the state again."""
    if joint is None:
        return False
    left = residual_energy(trial, joint)
    return left > state.data.fit.rows and residual_energy(state, joint) < LIMITS.swapped * left


def tenable(candidate: Candidate, state: State) -> bool:
    """Whether a chosen candidate is admissible beside all others."""
    others = state.model.without(candidate, state)
    return state.model.admissible(state.model.conditional(candidate, others, state), others)
