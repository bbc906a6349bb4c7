"""An effect and its special cases: the whole in the place of its parts, or a part in the place of the whole."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from arm_model.effects import CATALOGUE, Effect, Excitation
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.replacement.next_orders import near_case_with_term
from diagnosis.measurements.currents.replacement.trial import followed
from diagnosis.measurements.currents.state import State
from diagnosis.selection.bodies import body_of, is_body
from diagnosis.selection.candidate import Candidate


def special_cases(state: State) -> State:
    """The state with fewer or simpler effects in the place of others, if the held-out residual hardly grows.

    Two special cases of an effect at one joint are replaced by that effect; an effect is replaced by a simpler one that
    it contains. While other causes were missing, the additional coefficients may have fitted their residual. A simpler
    one with a next-order term of its own takes its place if it leaves less.
    """
    model = state.model
    for substitutes, replaced in _replacements(state.chosen, model.library):
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
        more = LIMITS.min_gain * state.data.held_out.rows
        if _are_friction(substitutes, replaced):
            more = followed(state, LIMITS.min_gain).held_out
        possible = all(_is_body(trial, c) for c in substitutes if c.body)
        if possible and trial.energy.held_out - state.energy.held_out < more:
            state = trial
        elif len(substitutes) == 1 and (better := near_case_with_term(state, replaced[0], substitutes[0])) is not None:
            state = better
    return state


def are_separate(some: Sequence[Candidate], whole: Effect) -> bool:
    """Whether these special cases of an effect are causes of their own."""
    return {c.effect for c in some} == set(whole.separate_cases)


def _are_friction(*candidates: Sequence[Candidate]) -> bool:
    """Whether all of them are friction: level and slope, equal in both directions or not."""
    return all(c.definition.friction for several in candidates for c in several)


def _is_body(state: State, chosen: Candidate) -> bool:
    """Whether the sizes that a chosen body has may be those of one."""
    return is_body(estimates_of(state)[state.chosen.index(chosen)], LIMITS.body_deviations)


def _replacements(
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
            if len(own) > 1 and not all(c.definition.friction for c in own) and not are_separate(own, whole):
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
