"""Causes that are names for parts of unexplained structure, and are withdrawn.

Not one that explains nearly all of the excess at its joint, where the rest depends on the variable of its own law: what
it leaves is reported beside it (``dominant``).
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace

import numpy as np

from arm_model.effects import Instrument
from diagnosis.cause import Signal, Structure
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.dominant import (
    dominant,
    explained_alone,
    family_dominates,
    of_own_variable,
)
from diagnosis.measurements.currents.structure.likely_variable import DRIFT, likely_variable, share_kept
from diagnosis.measurements.currents.structure.noise_ratio import noise_ratio
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.unexplained import Unexplained, better_than_causes
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns
from diagnosis.selection.next_order import next_orders, of_last_term
from diagnosis.selection.regression import at_joint, score, with_columns


def spurious(state: State, unexplained: Unexplained, bases: Bases) -> list[Candidate]:
    """Chosen candidates that only name a part of the structure that remains unexplained; empty if none does."""
    dominating = dominant(state)
    return _superfluous(state, unexplained, dominating) or _outdone(state, dominating, bases) or _of_a_drift(state)


def of_another_order(state: State) -> tuple[list[Candidate], Structure] | None:
    """The cause of which a next-order term explains too much to be one, and what is against its variable then.

    Its law is not the leading order. A line follows the cube of an angle to some extent in any range, the better with a
    line for every recording; what it leaves may be within the noise of the whole joint. That the cube follows held-out
    rows is the proof that the line is no spring. Another cause of that joint is withdrawn with it if the term explains
    as much in its place, with fewer coefficients. Terms of time prove nothing: time has no natural origin, and friction
    may begin where it is that of the model.
    """
    found = _of_another_order(state, None)
    return found or next((pair for c in state.chosen if (pair := _of_another_order(state, c)) is not None), None)


def _of_another_order(state: State, other: Candidate | None) -> tuple[list[Candidate], Structure] | None:
    """``of_another_order`` with the term in the place of another cause of its joint, if one is given."""
    model, held_out = state.model, state.data.held_out
    reduced = state if other is None else model.without(other, state)
    rival = None if other is None else model.conditional(other, reduced, state)
    for c, own in zip(reduced.chosen, reduced.coefficients):
        if c.joint is None or (other is not None and other.joint != c.joint):
            continue
        for term in next_orders(c, own, model.seconds):
            if c.definition.lasting(term.terms[-1]) is not None:
                continue
            of_term = score(term, of_last_term(model.columns(term)), reduced.fitted, held_out)
            significant = of_term.p < LIMITS.structure_p and of_term.gain > LIMITS.structure_gain * held_out.rows
            equal = rival is None or (
                of_term.determined < rival.determined and of_term.gain >= rival.gain - model.tolerance(of_term, rival)
            )
            if significant and equal and not model.is_next_order(of_term, reduced):
                without = model.without(c, reduced)
                gain = of_term.gain + model.conditional(c, without, reduced).gain
                share = gain / float(np.sum(without.residual.held_out[held_out.of(c.joint)] ** 2))
                against = str(c.definition.observed_by[Instrument.CURRENT].against)
                withdrawn = [c] if other is None else [c, other]
                return withdrawn, Structure(Signal.CURRENT, c.joint, against, share)
    return None


def _superfluous(state: State, unexplained: Unexplained, kept: Container[Candidate]) -> list[Candidate]:
    """The cause that is most superfluous conditional on unexplained structure, if one is."""
    shares = {c: share for c in state.chosen if (share := _share_beside(c, state, unexplained, kept)) is not None}
    least = min(shares, key=lambda c: shares[c], default=None)
    return [least] if least is not None and shares[least] < LIMITS.superfluous else []


def _share_beside(
    candidate: Candidate, state: State, unexplained: Unexplained, kept: Container[Candidate]
) -> float | None:
    """Share of its gain that a cause keeps conditional on unexplained structure; None where no structure judges it.

    * Structure of a known variable that acts in the same rows: the gain beside it. None for one of the ``kept`` if the
      structure depends on the variable of its own law.
    * A residual above the noise that most likely depends on a variable: the gain beside a function of it. A function of
      the variable of a law follows the right law of it as well; laws of that variable keep all if together they are
      nearly all of the excess (``family_dominates``), and else what they explain alone.
    * A residual above the noise that depends on no known variable: the gain over that residual, as a cause that
      explains less than is left is part of it.

    The last two judge causes of that joint only: what one joint leaves does not judge a load of the arm. What is no
    share of the gain is scaled by ``LIMITS.superfluous``: it is below that limit where the cause is superfluous.
    """
    model, held_out, joint = state.model, state.data.held_out, candidate.joint
    against = [one.against for one in unexplained.structures if one.joint == joint]
    if candidate in kept and of_own_variable(candidate, against):
        return None
    others, own = model.without(candidate, state), model.columns(candidate)
    touching = [pair for pair in unexplained.pairs if _overlap(pair.fit, own.fit)]
    alone = score(candidate, own, others.fitted, held_out).gain
    if touching:
        beside = score(candidate, own, with_columns(others.fitted, touching), held_out).gain
        # another cause may have made it superfluous already
        return beside / alone if alone > 0.0 else 0.0
    if joint is None:
        return None
    if (likely := unexplained.likely.get(joint)) is not None:
        if not of_own_variable(candidate, [likely.variable]):
            others_columns = [*others.free, *(model.columns(one) for one in others.chosen)]
            return share_kept(likely, own, others_columns, state.data)
        if family_dominates(candidate, likely.variable, state):
            return None
        return LIMITS.superfluous * explained_alone([candidate], state)
    if any(structure.joint == joint and not structure.share for structure in unexplained.structures):
        return LIMITS.superfluous * alone / float(np.sum(state.residual.held_out[held_out.of(joint)] ** 2))
    return None


def _outdone(state: State, kept: Container[Candidate], bases: Bases) -> list[Candidate]:
    """The causes of a joint that one function of one variable explains better than all of them together.

    Less those of the ``kept`` that have a law of that variable, or than which no function is better by more than what
    a right law may miss, or than what is known to be off in an identified model.
    """
    model, held_out = state.model, state.data.held_out
    for joint in sorted({c.joint for c in state.chosen if c.joint}):
        own = [c for c in state.chosen if c.joint == joint]
        reduced = replace(state, chosen=tuple(c for c in state.chosen if c not in own))
        before, after = (float(np.sum(s.residual.held_out[held_out.of(joint)] ** 2)) for s in (reduced, state))
        coefficients = sum(at_joint(model.columns(c).fit, joint, state.data.fit).determined for c in own)
        several = len(own) > 1 and (coefficients >= LIMITS.many or len(own) >= LIMITS.many_causes)
        allowed = LIMITS.many_leave * after if several else 0.0
        better = better_than_causes(bases, reduced.fitted, state.fitted, model.arm, joint, allowed)
        # a function of the right variable also follows the residual that an identified model leaves on any day
        times = state.significance.allowed.held_out[joint - 1]
        better = {name: gain for name, gain in better.items() if allowed or gain > (times**2 - 1.0) * held_out.rows}
        missed = LIMITS.structure_share * (before - after)
        left = noise_ratio(state.residual.held_out, held_out, joint)
        within = model.uncertain is not None and left <= LIMITS.above_noise * times
        clearly = [] if within else [variable for variable, gain in better.items() if gain > missed]
        if better and (outdone := [c for c in own if not (c in kept and of_own_variable(c, clearly))]):
            return outdone
    return []


def _of_a_drift(state: State) -> list[Candidate]:
    """The cause of a joint that is no more than the level of a drift of each recording's own.

    No recording predicts the drift of another, so that no function of time that held-out rows confirm has a part in it.
    What a cause leaves must be above the noise, by less than makes it structure of its own, and more than a right law
    leaves; and most of it must be a drift, beside which the cause explains little.
    """
    model = state.model
    for joint in sorted({c.joint for c in state.chosen if c.joint}):
        own = [c for c in state.chosen if c.joint == joint and not of_own_variable(c, [DRIFT])]
        if not own or noise_ratio(state.residual.held_out, state.data.held_out, joint) <= LIMITS.noise:
            continue
        if explained_alone([c for c in state.chosen if c.joint == joint], state) > LIMITS.dominant:
            continue
        likely = likely_variable(state.data, state.residual, model.arm, joint)
        if likely is None or likely.variable != DRIFT:
            continue
        for c in own:
            others = [*state.free, *(model.columns(one) for one in state.chosen if one is not c)]
            if share_kept(likely, model.columns(c), others, state.data) < LIMITS.superfluous:
                return [c]
    return []


def _overlap(a: Columns, b: Columns) -> bool:
    return a.where.start < b.where.stop and b.where.start < a.where.stop
