"""The search for causes in the currents.

Stepwise selection, refinement by the exact model, simplification, and comparison with unexplained structure.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model.effects import CATALOGUE, Excitation
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.design_matrix import dataset_with
from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.possible import exists
from diagnosis.measurements.currents.state import State, corrected, terms
from diagnosis.measurements.currents.structure.dominant import (
    dominant,
    explained_alone,
    family_dominates,
    of_own_variable,
)
from diagnosis.measurements.currents.structure.likely_variable import kept_beside
from diagnosis.measurements.currents.structure.noise_ratio import noise_ratio
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.unexplained import Unexplained, better_than_causes, unexplained_structure
from diagnosis.selection.bodies import bodies_of_link, body_of, is_body, link_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns
from diagnosis.selection.regression import score, with_columns
from identification.selection import Score, eliminate, select


@dataclass(frozen=True)
class Found:
    """The chosen candidates, and the unexplained structure conditional on them."""

    state: State
    unexplained: Unexplained


def search(model: Currents, progress: Callable[[str], None]) -> Found:
    """Candidates that explain the residual together, and the structure that they leave unexplained."""
    state = simplified(named_by_body(gauss_newton_refined(select(model, progress))))
    if len(fewer := eliminate(model, state).chosen) < len(state.chosen):
        state = model.refitted(fewer, state.rivals)
    progress("searching for unexplained structure")
    return _undissolved(state)


def named_by_body(state: State) -> State:
    """The state with a body in the place of the change of the link that carries it, or the reverse.

    Whichever is chosen: their columns are the same (``diagnosis.selection.bodies``).
    """
    model = state.model
    for c in state.chosen:
        link = link_of(c, model.arm) if c.body else c
        for body in bodies_of_link(link, model.arm):
            chosen = [one for one in state.chosen if one not in (link, c) and one.key != body.key]
            rivals = [one for key in (body.key, link.key) for one in state.rivals.get(key, ())]
            as_body = _in_place(state, (*chosen, body), body, rivals)
            possible = body.key not in model.excluded and is_body(
                estimates_of(as_body)[-1], model.limits.body_deviations
            )
            if possible or c.body:
                return as_body if possible else _in_place(state, (*chosen, link), link, rivals)
    return state


def _in_place(state: State, chosen: Sequence[Candidate], last: Candidate, rivals: Sequence[Score[Candidate]]) -> State:
    return state.model.refitted(chosen, {**state.rivals, last.key: rivals})


def without(found: Found, removed: Candidate) -> Found:
    """What was found, less one candidate; the others fitted anew, and judged anew by what is left without it."""
    state = found.state
    return _undissolved(state.model.refitted([c for c in state.chosen if c is not removed], state.rivals))


def _undissolved(state: State) -> Found:
    """The causes of a state that are no names for parts of unexplained structure, and that structure."""
    bases = Bases(*state.data)
    found = _with_unexplained(state, bases)
    while dissolved := _dissolved(found, bases):
        state = corrected(replace(state, chosen=tuple(c for c in state.chosen if c not in dissolved)))
        found = _with_unexplained(state, bases)
    return found


def _with_unexplained(state: State, bases: Bases) -> Found:
    return Found(state, unexplained_structure(state.data, state.fitted, state.model.arm, state.significance, bases))


def _dissolved(found: Found, bases: Bases) -> list[Candidate]:
    """Causes that are names for parts of unexplained structure.

    Not one that explains nearly all of the excess at its joint, where the rest depends on the variable of its own law:
    what it leaves is told beside it (``dominant``).
    """
    kept = dominant(found.state)
    return _superfluous(found, kept) or _outdone(found.state, kept, bases) or _compensating(found.state)


def _superfluous(found: Found, kept: Container[Candidate]) -> list[Candidate]:
    """The cause that is most superfluous conditional on unexplained structure, if one is.

    None of the ``kept`` where that structure depends on the variable of its own law.
    Where the residual is above the noise and depends on no known variable, a cause that explains less than is left is
    part of it. Where it most likely depends on one, a cause must explain beside a function of that variable what it
    explains without. That says so of causes of that joint alone: what one joint leaves does not judge a load of the
    arm. A function of the variable of a law follows any law of it, also a right one: laws of that variable stay if they
    are nearly all of the excess together (``family_dominates``), or the law is another one.
    """
    state, shares = found.state, dict[Candidate, float]()
    model, held_out = state.model, state.data.held_out
    unknown = {structure.joint for structure in found.unexplained.structures if not structure.share}
    for c in state.chosen:
        against = [one.against for one in found.unexplained.structures if one.joint == c.joint]
        if c in kept and of_own_variable(c, against):
            continue
        others, own = model.without(c, state), model.columns(c)
        touching = [pair for pair in found.unexplained.pairs if _overlap(pair.fit, own.fit)]
        alone = score(c, own, others.fitted, held_out).gain
        if touching:
            shares[c] = score(c, own, with_columns(others.fitted, touching), held_out).gain / alone
        if touching or c.joint is None:
            continue
        if (likely := found.unexplained.likely.get(c.joint)) is not None:
            if not of_own_variable(c, [likely.variable]):
                beside = [*others.free, *(model.columns(one) for one in others.chosen)]
                shares[c] = kept_beside(likely, own, beside, state.data)
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
        # a function of the right variable follows what an identified model leaves on any day as well
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
            c: float(np.sum(state.model.columns(c).held_out.spread(own, len(held_out.y))[rows] ** 2))
            for c, own in zip(state.chosen, state.coefficients)
        }
        foreign = any(energy[c] > held_out.rows for c in state.chosen if c.joint != joint)
        if foreign and sum(energy.values()) > state.model.limits.compensating * float(np.sum(held_out.y[rows] ** 2)):
            return [c for c in state.chosen if energy[c] > held_out.rows]
    return []


def _cancelling(own: Sequence[Candidate], state: State) -> float:
    """Sum of the energies of what some of the chosen explain, over the energy of the sum; 1 if independent."""
    contributions = [
        state.model.columns(c).fit.spread(coefficients, len(state.fitted.fit))
        for c, coefficients in zip(state.chosen, state.coefficients)
        if c in own
    ]
    return float(
        sum(np.sum(contribution**2) for contribution in contributions) / np.sum(np.sum(contributions, axis=0) ** 2)
    )


def _overlap(a: Columns, b: Columns) -> bool:
    return a.where.start < b.where.stop and b.where.start < a.where.stop


def simplified(state: State) -> State:
    """The state with fewer or simpler effects in the place of others, if the held-out residual hardly grows.

    Two special cases of an effect at one joint are replaced by that effect; an effect is replaced by a simpler one that
    it contains. While other causes were missing, the additional coefficients may have fitted their residual. A simpler
    one with a next-order term of its own takes its place if it leaves less.
    """
    model = state.model
    if not state.chosen:
        return state
    # as each trial below: to first order, an error of the gain takes its share of the noise with it
    state = model.refitted(state.chosen, state.rivals)
    for substitutes, replaced in _simpler(state.chosen, model.library):
        chosen = state.chosen
        available = all((c.body or c in model.library) and c.key not in model.excluded for c in substitutes)
        if not available or set(substitutes) & set(chosen) or not set(replaced) <= set(chosen):
            continue
        rivals = [rival for rival in state.rivals[replaced[0].key] if rival.candidate.key != replaced[0].key]
        place = chosen.index(replaced[0])
        others = [c for c in chosen if c not in replaced]
        trial = model.refitted(
            [*others[:place], *substitutes, *others[place:]],
            {**state.rivals, **{c.key: rivals for c in substitutes}},
        )
        left, left_by_trial = _held_out_left(state), _held_out_left(trial)
        noise = float(state.data.held_out.rows)
        # where much is left that no effect explains, more coefficients follow some of it
        beyond = max(left - noise * len(model.arm), 0.0) if _friction_alone(substitutes, replaced) else 0.0
        possible = all(_is_body(trial, c) for c in substitutes if c.body)
        if possible and left_by_trial - left < max(model.limits.min_gain * noise, model.limits.follows * beyond):
            state = trial
        elif (better := _by_next_order(state, substitutes, replaced[0], left)) is not None:
            state = better
    return state


def _is_body(state: State, chosen: Candidate) -> bool:
    """Whether the sizes that a chosen body has may be those of one."""
    return is_body(estimates_of(state)[state.chosen.index(chosen)], state.model.limits.body_deviations)


def _by_next_order(state: State, substitutes: Sequence[Candidate], cause: Candidate, left: float) -> State | None:
    """The state with a near case of a cause and a next-order term of its law, if that leaves less than ``left``."""
    (substitute, *others) = substitutes
    if others or substitute.effect not in cause.definition.near_cases or not substitute.definition.terms:
        return None
    trial = state.model.with_terms(replace(state, rivals={**state.rivals, substitute.key: ()}), cause, substitute)
    # first-order columns screen: only what they show is evaluated exactly
    if _held_out_left(trial) >= left:
        return None
    exact = state.model.refitted(trial.chosen, trial.rivals)
    return exact if _held_out_left(exact) < left else None


def _held_out_left(state: State) -> float:
    """Squared held-out residual, in units of the noise variance."""
    return float(np.sum(state.fitted.held_out**2))


def _friction_alone(*candidates: Sequence[Candidate]) -> bool:
    """Whether all of them are friction: level and slope, equal in both directions or not."""
    return all(c.definition.friction for several in candidates for c in several)


def _simpler(
    chosen: Sequence[Candidate], library: Iterable[Candidate]
) -> Iterator[tuple[tuple[Candidate, ...], tuple[Candidate, ...]]]:
    """Candidates, and those of the chosen that they may replace.

    The whole for several parts, a part for the whole, and two parts that are friction for a whole. Level and slope of
    friction that is equal in both directions are two causes: they are no parts of an asymmetry. A mass point and an
    inertia about one axis are parts of a body: about its centre it has some.
    """
    of_key: dict[EffectKey, list[Candidate]] = {}
    for c in library:
        of_key.setdefault(c.key, []).append(c)
    for whole in CATALOGUE.values():
        for joint in sorted({c.joint for c in chosen if c.joint}):
            own = tuple(c for c in chosen if c.joint == joint and c.effect in whole.special_cases)
            if len(own) > 1 and not all(c.definition.friction for c in own):
                yield (Candidate(whole.name, joint),), own
    for c in chosen:
        if c.body:
            yield (replace(c, body=False),), (c,)
        elif (body := body_of(c)) is not None:
            parts = (one for one in chosen if one.joint and _is_inertia(one, body))
            yield from (((body,), (c, part)) for part in parts)
        for part in (*c.definition.special_cases, *c.definition.near_cases):
            yield from (((substitute,), (c,)) for substitute in of_key.get((part, c.joint), ()))
        friction = [part for part in c.definition.special_cases if CATALOGUE[part].friction]
        for pair in itertools.combinations(friction, 2):
            several = itertools.product(*(of_key.get((part, c.joint), ()) for part in pair))
            yield from ((both, (c,)) for both in several)


def _is_inertia(candidate: Candidate, body: Candidate) -> bool:
    """Whether a candidate follows the acceleration as the inertia of a body does."""
    effect = candidate.definition
    return effect.excited_by is Excitation.ACCELERATION and body.definition.body in effect.confused_with


def gauss_newton_refined(state: State) -> State:
    """The state after a Gauss-Newton step of its nonlinear parameters in the exact model, if the residual falls.

    Unchanged where the chosen effects make no arm that exists.
    """
    searched = [(k, name) for k, c in enumerate(state.chosen) for name in c.searched()]
    if not searched:
        return state
    model, own, basis = state.model, state.coefficients, state.fitted.basis
    if not exists(model.arm, state.terms):
        return state
    here = dataset_with(model.data.fit, state.terms)

    def slope_of(place: tuple[int, str]) -> Array:
        k, name = place
        value = dict(state.chosen[k].shape)[name]
        step = 0.02 * value
        moved = [c.at(name, value + step) if n == k else c for n, c in enumerate(state.chosen)]
        return (dataset_with(model.data.fit, terms(moved, own)) - here) / step

    slope = np.stack(in_parallel(slope_of, searched), axis=1)
    slope -= basis @ (basis.T @ slope)
    change = -np.linalg.lstsq(slope, here - basis @ (basis.T @ here), rcond=1e-3)[0]
    better = list(state.chosen)
    for (k, name), by in zip(searched, change):
        value = dict(better[k].shape)[name]
        better[k] = better[k].at(name, float(np.clip(value + by, value / 2, 2 * value)))
    as_is, moved_on = (model.refitted(chosen, state.rivals) for chosen in (state.chosen, better))
    return moved_on if np.sum(moved_on.fitted.fit**2) < np.sum(as_is.fitted.fit**2) else state
