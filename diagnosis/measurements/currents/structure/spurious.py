"""Causes that are names for parts of unexplained structure, and are withdrawn.

Not one that explains nearly all of the excess at its joint, where the rest depends on the variable of its own law: what
it leaves is reported beside it (``dominant``).
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.dominant import (
    dominant,
    explained_alone,
    family_dominates,
    of_own_variable,
)
from diagnosis.measurements.currents.structure.likely_variable import share_kept
from diagnosis.measurements.currents.structure.noise_ratio import noise_ratio
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.unexplained import Unexplained, better_than_causes
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns
from diagnosis.selection.regression import score, with_columns


def spurious(state: State, unexplained: Unexplained, bases: Bases) -> list[Candidate]:
    """Chosen candidates that only name a part of the structure that remains unexplained; empty if none does."""
    dominating = dominant(state)
    return _superfluous(state, unexplained, dominating) or _outdone(state, dominating, bases) or _compensating(state)


def _superfluous(state: State, unexplained: Unexplained, kept: Container[Candidate]) -> list[Candidate]:
    """The cause that is most superfluous conditional on unexplained structure, if one is.

    None of the ``kept`` where that structure depends on the variable of its own law.
    Where the residual is above the noise and depends on no known variable, a cause that explains less than is left is
    part of it. Where it most likely depends on one, a cause must explain beside a function of that variable what it
    explains without. That says so of causes of that joint alone: what one joint leaves does not judge a load of the
    arm. A function of the variable of a law follows any law of it, also a right one: laws of that variable stay if they
    are nearly all of the excess together (``family_dominates``), or the law is another one.
    """
    model, held_out, shares = state.model, state.data.held_out, dict[Candidate, float]()
    unknown = {structure.joint for structure in unexplained.structures if not structure.share}
    for c in state.chosen:
        against = [one.against for one in unexplained.structures if one.joint == c.joint]
        if c in kept and of_own_variable(c, against):
            continue
        others, own = model.without(c, state), model.columns(c)
        touching = [pair for pair in unexplained.pairs if _overlap(pair.fit, own.fit)]
        alone = score(c, own, others.fitted, held_out).gain
        if touching:
            shares[c] = score(c, own, with_columns(others.fitted, touching), held_out).gain / alone
        if touching or c.joint is None:
            continue
        if (likely := unexplained.likely.get(c.joint)) is not None:
            if not of_own_variable(c, [likely.variable]):
                others_columns = [*others.free, *(model.columns(one) for one in others.chosen)]
                shares[c] = share_kept(likely, own, others_columns, state.data)
            elif not family_dominates(c, likely.variable, state):
                shares[c] = model.limits.superfluous * explained_alone([c], state)
        elif c.joint in unknown:
            energy = float(np.sum(state.fitted.held_out[held_out.of(c.joint)] ** 2))
            shares[c] = model.limits.superfluous * alone / energy
    least = min(shares, key=lambda c: shares[c], default=None)
    return [least] if least is not None and shares[least] < model.limits.superfluous else []


def _outdone(state: State, kept: Container[Candidate], bases: Bases) -> list[Candidate]:
    """The causes of a joint that one function of one variable explains better than all of them together.

    Less those of the ``kept`` that have a law of that variable, or than which no function is better by more than what
    a right law may miss, or than what is known to be off in an identified model.
    """
    model, limits, held_out = state.model, state.model.limits, state.data.held_out
    for joint in sorted({c.joint for c in state.chosen if c.joint}):
        own = [c for c in state.chosen if c.joint == joint]
        reduced = replace(state, chosen=tuple(c for c in state.chosen if c not in own))
        before, after = (float(np.sum(s.fitted.held_out[held_out.of(joint)] ** 2)) for s in (reduced, state))
        allowed = 0.0
        coefficients = sum(model.columns(c).fit.x.shape[1] for c in own)
        if len(own) > 1 and (coefficients >= limits.many or len(own) >= limits.many_causes):
            allowed = limits.many_leave * after
        if len(own) > 3 and _cancelling(own, state) > limits.makeshift:
            allowed = max(allowed, limits.makeshift_leave * (before - after))
        better = better_than_causes(bases, reduced.fitted, state.fitted, model.arm, joint, allowed)
        # a function of the right variable also follows the residual that an identified model leaves on any day
        times = state.significance.allowed.held_out[joint - 1]
        better = {name: gain for name, gain in better.items() if allowed or gain > (times**2 - 1.0) * held_out.rows}
        missed = limits.structure_share * (before - after)
        left = noise_ratio(state.fitted.held_out, held_out, joint)
        within = model.uncertain is not None and left <= limits.above_noise * times
        clearly = [] if within else [variable for variable, gain in better.items() if gain > missed]
        if better and (outdone := [c for c in own if not (c in kept and of_own_variable(c, clearly))]):
            return outdone
    return []


def _compensating(state: State) -> list[Candidate]:
    """Causes of a joint, and of the arm or another joint, whose contributions there cancel each other.

    What they contribute is far more than there was to explain: one name was given to something that acts at another
    joint alone, and the others make up for what it does here.
    """
    held_out = state.data.held_out
    for joint in sorted({c.joint for c in state.chosen if c.joint}):
        rows = held_out.of(joint)
        energy = {
            c: float(np.sum(state.model.columns(c).held_out.contribution(own, len(held_out.y))[rows] ** 2))
            for c, own in zip(state.chosen, state.coefficients)
        }
        foreign = any(energy[c] > held_out.rows for c in state.chosen if c.joint != joint)
        if foreign and sum(energy.values()) > state.model.limits.compensating * float(np.sum(held_out.y[rows] ** 2)):
            return [c for c in state.chosen if energy[c] > held_out.rows]
    return []


def _cancelling(own: Sequence[Candidate], state: State) -> float:
    """Sum of the energies of the contributions of some candidates over the energy of their sum; 1 if independent."""
    contributions = [
        state.model.columns(c).fit.contribution(coefficients, len(state.fitted.fit))
        for c, coefficients in zip(state.chosen, state.coefficients)
        if c in own
    ]
    return float(
        sum(np.sum(contribution**2) for contribution in contributions) / np.sum(np.sum(contributions, axis=0) ** 2)
    )


def _overlap(a: Columns, b: Columns) -> bool:
    return a.where.start < b.where.stop and b.where.start < a.where.stop
