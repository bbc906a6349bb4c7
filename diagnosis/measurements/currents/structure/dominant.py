"""Causes that explain nearly all of the excess at their joint, and what remains beside them.

Excess is the squared residual above that of the noise, and above what is known to be off in an identified model. A
smooth function of the right variable follows any effect better than a law that is nearly right. A law that alone
explains nearly all of the excess, in fitted and held-out recordings, is still the name of it, if that function is one
of the variable of the law. Where a function of another variable follows the residual better, another law is at work:
friction of one direction explains 95 % of a torque that a drive loses in proportion to its load.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model.effects import CATALOGUE, Instrument, same_columns
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.state import State
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset


def dominant(state: State) -> list[Candidate]:
    """The chosen candidates of one joint that alone explain ``LIMITS.dominant`` of its excess; one per joint."""
    dominating = []
    for joint in sorted({c.joint for c in state.chosen if c.joint}):
        own = ((explained_alone([c], state), c) for c in state.chosen if c.joint == joint)
        share, best = max(own, key=lambda one: one[0])
        if share > LIMITS.dominant:
            dominating.append(best)
    return dominating


def of_own_variable(candidate: Candidate, variables: Iterable[str]) -> bool:
    """Whether a residual that depends on ``variables`` depends only on those in the candidate's own law.

    Applies to laws at one joint: a change of the description (masses, geometry) depends on many variables. One that has
    the columns of a law, as a torque constant has those of a gain, is that law to the recordings.
    """
    every = (candidate.definition, *(CATALOGUE[name] for name in same_columns(candidate.definition)))
    laws = [effect for effect in every if effect.torque is not None or effect.current is not None]
    own = {effect.observed_by[Instrument.CURRENT].against for effect in laws}
    return bool(laws) and all(variable in own for variable in variables)


def family_dominates(candidate: Candidate, variable: str, state: State) -> bool:
    """Whether the chosen laws of one variable, a candidate's among them, explain ``LIMITS.dominant`` of its excess.

    Level and slope of friction are two laws of the velocity: a friction curve that grew is nearly all of it in both.
    """
    own = [c for c in state.chosen if c.joint == candidate.joint and of_own_variable(c, [variable])]
    return candidate in own and explained_alone(own, state) > LIMITS.dominant


def explained_alone(own: Sequence[Candidate], state: State) -> float:
    """Share of the excess at their joint that these candidates explain without the others that act there.

    The smaller of the shares in fitted and in held-out recordings.
    """
    joint = own[0].joint
    assert joint is not None
    others = tuple(c for c in state.chosen if c.joint not in (joint, None))
    without, alone = replace(state, chosen=others), replace(state, chosen=(*others, *own))
    shares = []
    for part, before, after, allowed in zip(state.data, without.residual, alone.residual, state.significance.allowed):
        excess, remaining = (_excess(y, part, joint, allowed[joint - 1]) for y in (before, after))
        shares.append(1.0 - remaining / excess if excess > 0.0 else 0.0)
    return min(shares)


def remainder_of(candidate: Candidate, state: State) -> float:
    """Rms of the excess that all causes leave at its joint, over that without the candidate; held out."""
    assert candidate.joint is not None
    without, held_out = state.model.without(candidate, state), state.data.held_out
    allowed = state.significance.allowed.held_out[candidate.joint - 1]
    excess, remaining = (_excess(one.residual.held_out, held_out, candidate.joint, allowed) for one in (without, state))
    return float(np.sqrt(remaining / excess)) if excess > 0.0 else 0.0


def _excess(whitened: Array, side: Dataset, joint: int, allowed: float) -> float:
    """Squared residual of a joint above ``allowed`` times the noise, whose variance is 1."""
    return max(float(np.sum(whitened[side.of(joint)] ** 2)) - allowed**2 * side.rows, 0.0)
