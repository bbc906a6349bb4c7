"""Other effects in the place of those that a search chose: fewer, simpler ones, or with no more coefficients.

Forward selection takes the law that predicts held-out rows best. Where these hardly move a joint, or move it in one
way, a law of several coefficients does as well there as two effects that it is none of, and hides both of them. So one
or two effects take the place of one or two causes of their joint (``exchanged``) if they have no more coefficients,
predict held-out rows as well, and leave at most half of what the causes leave of the fitted rows: with no more
coefficients, that is not by chance.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arm_model.effects import CATALOGUE, Effect, Excitation, same_columns
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.state import State
from diagnosis.selection.bodies import body_of, is_body
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns
from diagnosis.selection.regression import at_joint, best_of_each, fit_gain
from identification.selection import Split, p_value

if TYPE_CHECKING:
    from diagnosis.measurements.currents.model import Currents

SEVERAL = 4
"""Coefficients from which on a cause may have followed another effect that was missing when it was chosen."""
BEAM = 3
"""Sets that are fitted to all joints and evaluated exactly, of those that leave least of the fitted rows of a joint."""


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
    state = _by_two(_by_fewer(_one_for_several(model.refitted(state.chosen, state.rivals))))
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
        energy, energy_of_trial = state.energy.held_out, trial.energy.held_out
        more = model.limits.min_gain * state.data.held_out.rows
        if _friction_alone(substitutes, replaced):
            more = _followed(state, model.limits.min_gain).held_out
        possible = all(_is_body(trial, c) for c in substitutes if c.body)
        if possible and energy_of_trial - energy < more:
            state = trial
        elif (better := _by_next_order(state, substitutes, replaced[0], energy)) is not None:
            state = better
    return state


def _one_for_several(state: State) -> State:
    """The state with a rival of a cause in its place that makes all later causes of its joint superfluous.

    A simpler cause is chosen first among those whose gains differ by less than first-order columns are wrong. What it
    leaves of a richer one, other causes then imitate. Not where ``exchanged`` would take these causes again.
    """
    model, noise = state.model, float(state.data.held_out.rows)
    for c in state.chosen:
        place = state.chosen.index(c) if c in state.chosen else len(state.chosen)
        later = [one for one in state.chosen[place + 1 :] if c.joint in (one.joint, None)]
        for rival in (score.candidate for score in state.rivals.get(c.key, ()) if later):
            others = [one for one in state.chosen if one is not c and one not in later]
            if rival.terms or rival.key in model.excluded or rival.key in {one.key for one in state.chosen}:
                continue
            trial = model.refitted([*others[:place], rival, *others[place:]], {**state.rivals, rival.key: ()})
            as_well = trial.energy.held_out - state.energy.held_out < model.limits.min_gain * noise
            if as_well and not _clearly_worse(trial, state, rival.joint):
                own = [one for one in state.rivals[c.key] if one.candidate.key != rival.key]
                state = replace(trial, rivals={**state.rivals, rival.key: own})
                break
    return state


def _by_fewer(state: State) -> State:
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
        trials: list[State] = []
        for rival in model.rivals_of(c, state):
            fewer = int(np.count_nonzero(coefficients)) - rival.determined
            if fewer <= 0 or rival.candidate.terms:
                continue
            chosen = [rival.candidate if one is c else one for one in state.chosen]
            own = [one for one in state.rivals.get(c.key, ()) if one.candidate.key != rival.candidate.key]
            trial = model.refitted(chosen, {**state.rivals, rival.candidate.key: own})
            tolerance = max(LIMITS.tie * gain * fewer, LIMITS.tie_floor * state.data.held_out.rows)
            if trial.energy.held_out - state.energy.held_out < tolerance:
                trials.append(trial)
        joints = range(1, len(model.arm) + 1)
        trials = [one for one in trials if not any(_clearly_worse(one, state, joint) for joint in joints)]
        state = min(trials, key=lambda one: one.energy.held_out, default=state)
    return state


def _by_two(state: State) -> State:
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
        parts = {both: _with(both, without) for both in itertools.combinations(of_parts, 2)}
        most = _no_worse(state, c.joint, state.data.map(lambda part: LIMITS.tie_floor * part.rows))
        trials = {some: _with(some, without) for some in _sets(without, c.joint, determined - 1, most.fit)}
        allowed = [
            both for both in parts if _separate(both, c.definition) and not {one.key for one in both} & model.excluded
        ]
        trials |= {both: parts[both] for both in allowed}
        most_of_parts = _no_worse(state, c.joint, _followed(state, LIMITS.tie_floor))
        better = [
            tenable
            for some, trial in trials.items()
            if _leaves(trial, c.joint, most_of_parts if some in allowed else most)
            and not _predicts_more(state, trial)
            and all(_predicts_more(trial, one) for both, one in parts.items() if both != some)
            and (tenable := _tenable_of(some, trial, without, parts=some in allowed)) is not None
        ]
        if better:
            state = _with_rivals(min(better, key=lambda trial: sum(trial.energy)), kept)
    return state


def _no_worse(state: State, joint: int, by: Split[float]) -> Split[float]:
    """Energies that a trial may leave: of the fitted rows of a joint, and of all held-out rows."""
    return replace(by, fit=_residual_energy(state, joint) + by.fit, held_out=state.energy.held_out + by.held_out)


def _leaves(trial: State, joint: int, most: Split[float]) -> bool:
    """Whether a trial leaves less than ``most`` (``_no_worse``)."""
    return trial.energy.held_out < most.held_out and _residual_energy(trial, joint) < most.fit


def _followed(state: State, floor: float) -> Split[float]:
    """Energies that more coefficients of friction may take by following what no effect explains.

    floor: share of the noise energy that they may take in any case.
    """
    follows, joints = state.model.limits.follows, len(state.model.arm)

    def of(energy: float, rows: int) -> float:
        return max(floor * rows, follows * (energy - rows * joints))

    data, energy = state.data, state.energy
    return replace(energy, fit=of(energy.fit, data.fit.rows), held_out=of(energy.held_out, data.held_out.rows))


def _tenable_of(some: Sequence[Candidate], trial: State, without: State, *, parts: bool) -> State | None:
    """The trial if these of its candidates are tenable; of ``parts``, that with those that are; None where none is.

    What the other part of a law explains is then what the parameters of the model may be wrong by.
    """
    tenable = tuple(c for c in some if _tenable(c, trial))
    if len(tenable) == len(some):
        return trial
    alone = _with(tenable, without) if parts and tenable else None
    return alone if alone is not None and all(_tenable(c, alone) for c in tenable) else None


def _separate(some: Sequence[Candidate], whole: Effect) -> bool:
    """Whether these special cases of an effect are causes of their own."""
    return {c.effect for c in some} == set(whole.separate_cases)


def _with(some: Sequence[Candidate], state: State) -> State:
    """The state with further candidates, their rivals still unknown."""
    return state.model.refitted((*state.chosen, *some), {**state.rivals, **{c.key: () for c in some}})


def _with_rivals(state: State, kept: Sequence[Candidate]) -> State:
    """The state with the rivals of those of its candidates that are not among the ``kept``."""
    new = [c for c in state.chosen if c not in kept]
    return replace(state, rivals={**state.rivals, **{c.key: state.model.rivals_of(c, state) for c in new}})


def _predicts_more(state: State, other: State) -> bool:
    """Whether a state predicts held-out rows better than another by more than blocks differ by chance."""
    fall = other.residual.held_out**2 - state.residual.held_out**2
    return p_value(state.data.held_out.by_block(fall)) < LIMITS.ambiguity_p


def _clearly_worse(trial: State, state: State, joint: int | None) -> bool:
    """Whether a trial leaves so much of the fitted rows of a joint that ``exchanged`` would take the state again."""
    if joint is None:
        return False
    left = _residual_energy(trial, joint)
    return left > state.data.fit.rows and _residual_energy(state, joint) < LIMITS.swapped * left


def _is_body(state: State, chosen: Candidate) -> bool:
    """Whether the sizes that a chosen body has may be those of one."""
    return is_body(estimates_of(state)[state.chosen.index(chosen)], state.model.limits.body_deviations)


def _by_next_order(state: State, substitutes: Sequence[Candidate], cause: Candidate, energy: float) -> State | None:
    """The state with a near case of a cause and a next-order term of its law, if its held-out energy is lower."""
    (substitute, *others) = substitutes
    if others or substitute.effect not in cause.definition.near_cases or not substitute.definition.terms:
        return None
    trial = state.model.with_terms(replace(state, rivals={**state.rivals, substitute.key: ()}), cause, substitute)
    # first-order columns screen: only what they show is evaluated exactly
    if trial.energy.held_out >= energy:
        return None
    exact = state.model.refitted(trial.chosen, trial.rivals)
    return exact if exact.energy.held_out < energy else None


def _friction_alone(*candidates: Sequence[Candidate]) -> bool:
    """Whether all of them are friction: level and slope, equal in both directions or not."""
    return all(c.definition.friction for several in candidates for c in several)


def _simpler(
    chosen: Sequence[Candidate], library: Iterable[Candidate]
) -> Iterator[tuple[tuple[Candidate, ...], tuple[Candidate, ...]]]:
    """Candidates, and those of the chosen that they may replace.

    The whole for several parts, a part for the whole, and two parts that are friction for a whole. Level and slope of
    friction that is equal in both directions are two causes, and so are ``Effect.separate_cases``: no parts of an
    asymmetry. A mass point and an inertia about one axis are parts of a body: about its centre it has some.
    """
    of_key: dict[EffectKey, list[Candidate]] = {}
    for c in library:
        of_key.setdefault(c.key, []).append(c)
    for whole in CATALOGUE.values():
        for joint in sorted({c.joint for c in chosen if c.joint}):
            own = tuple(c for c in chosen if c.joint == joint and c.effect in whole.special_cases)
            if len(own) > 1 and not all(c.definition.friction for c in own) and not _separate(own, whole):
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


def exchanged(state: State) -> State | None:
    """The state with other causes at a joint; None where none are clearly better."""
    for joint in sorted({c.joint for c in state.chosen if c.joint is not None}):
        if _residual_energy(state, joint) < state.data.fit.rows:
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
    without, enough = model.refitted(kept, state.rivals), LIMITS.swapped * _residual_energy(state, joint)
    gain, rows = without.energy.held_out - state.energy.held_out, state.data.held_out.rows
    found: list[State] = []
    for others in _sets(without, joint, most, enough):
        trial = _with(others, without)
        tolerance = max(LIMITS.tie * gain * max(1, most - _coefficients(others, model)), LIMITS.tie_floor * rows)
        as_well = trial.energy.held_out < state.energy.held_out + tolerance
        if as_well and _residual_energy(trial, joint) < enough and all(_tenable(c, trial) for c in others):
            found.append(trial)
    if not found:
        return None
    return _with_rivals(min(found, key=lambda trial: sum(trial.energy)), kept)


def _sets(without: State, joint: int, most: int, enough: float) -> Iterator[tuple[Candidate, ...]]:
    """The best sets of one or two effects of a joint, of so many coefficients at most, that leave ``enough`` of it."""
    model, fitted, fit = without.model, without.fitted, without.data.fit
    of_joint = [c for c in model.library if c.joint == joint and not c.unit_amplitude]
    best = best_of_each(of_joint, model.library.at_own_joint, fitted, model.taken(without))
    own = {c: at_joint(model.columns(c).fit, joint, fit).x for c in best}
    pairs = (both for both in itertools.combinations(best, 2) if both[1].effect not in same_columns(both[0].definition))
    found: list[tuple[float, tuple[Candidate, ...]]] = []
    for some in (*itertools.combinations(best, 1), *pairs):
        if (coefficients := _coefficients(some, model)) <= most:
            x = Columns(np.hstack([own[c] for c in some]), fit.of(joint))
            left = _residual_energy(without, joint) - fit_gain(x, fitted)[0]
            if left < enough:
                # of equals, those with the fewest
                found.append((left + coefficients * LIMITS.tie_floor * fit.rows, some))
    return (some for _, some in sorted(found, key=lambda one: one[0])[:BEAM])


def _coefficients(some: Sequence[Candidate], model: Currents) -> int:
    """Number of their columns and searched parameters."""
    return sum(model.columns(c).fit.x.shape[1] + len(c.searched()) for c in some)


def _tenable(candidate: Candidate, state: State) -> bool:
    """Whether a chosen candidate is admissible beside all others."""
    others = state.model.without(candidate, state)
    return state.model.admissible(state.model.conditional(candidate, others, state), others)


def _residual_energy(state: State, joint: int) -> float:
    """Squared residual of the fitted rows of a joint, in units of the noise variance."""
    return float(np.sum(state.residual.fit[state.data.fit.of(joint)] ** 2))
