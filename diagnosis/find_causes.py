"""From recordings, seen through what is known of an arm, to causes: the search, what it must bear, and what only closed loops show.

A cause that the search found is given up where it is not told from nothing, or where the model's closed loop errs more with it than without; what
it stood for is then searched for again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial

from arm_model.description import Arm
from arm_model.effects import CATALOGUE
from daq.recording import Recording
from diagnosis.cause import Cause, EffectKey, extend
from diagnosis.closed_loop import resonance
from diagnosis.closed_loop.comparison import refuted, with_widths
from diagnosis.measurements.currents.causes import from_axis, of_candidate
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import columns_of, dataset_of, dataset_with, free_columns
from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.ripple_orders import order_of
from diagnosis.measurements.currents.search import Found, search, without
from diagnosis.measurements.single_axis.causes import AxisSide, axis_side, sharply
from diagnosis.residual.run import Run
from diagnosis.screening.cleaned import Sight, seen_through, with_edges
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Pair
from identification.selection.split import Split


@dataclass(frozen=True, kw_only=True)
class Named:
    """What the currents of recordings name beside what is known of the arm.

    arm, sight    the model with all that is known of it, and the recordings as it sees them
    base          the arm that the causes extend
    library       every candidate's columns; found: what the search chose of them; axis: of one axis seen finely
    causes        of the search or of the axis; terms: those of the search as effects; swung: a spring or play, which the arm has
    """

    arm: Arm
    sight: Sight
    base: Arm
    library: dict[Candidate, Pair]
    ripples: tuple[Candidate, ...]
    found: Found
    axis: AxisSide | None
    causes: list[Cause]
    swung: Cause | None = None


def named_causes(
    model: Arm,
    known: Sequence[Cause],
    fit: Sequence[Recording],
    held_out: Sequence[Recording],
    progress: Callable[[str], None],
) -> Named:
    """Names what the currents show beside the ``known`` causes of encoders and tracker: by the search, and by what swings in closed loop."""
    everything = [*fit, *held_out]
    parts = bool({r.path for r in fit} & {r.path for r in held_out})
    banned = {(one.effect, one.joint) for one in known if not one.by_tracker}
    arm = extend(model, known) if known else model
    sight = seen_through(arm, everything, progress)
    named = _searched(arm, sight, held_out, parts, banned, progress)
    if (behind := with_edges(sight, named.found.state.terms)) is not sight:
        named = _searched(arm, behind, held_out, parts, banned, progress)
    progress("looking for what swings")
    swung = _swung(named, fit, held_out) if has_dynamics(model) else None
    if swung is None:
        return named
    arm = extend(model, [*known, swung])  # the others are then judged by the arm that swings
    sight = with_edges(seen_through(arm, everything, progress), named.found.state.terms)
    banned |= {(effect, swung.joint) for effect in resonance.transmissions()}
    return replace(_searched(arm, sight, held_out, parts, banned, progress), swung=swung)


def _searched(
    arm: Arm,
    sight: Sight,
    held_out: Sequence[Recording],
    parts: bool,
    banned: Set[EffectKey],
    progress: Callable[[str], None],
) -> Named:
    """Names causes in recordings as they are seen, those held out last; none of ``banned``. parts: both sides are parts of the same recordings."""
    first = len(sight.runs) - len(held_out)
    runs, data = sight.runs, Split(dataset_of(sight.runs[:first]), dataset_of(sight.runs[first:]), parts)
    progress("computing what each effect would look like")
    every = tuple(c for c in candidates(arm) if c.key not in banned) if has_dynamics(arm) else ()
    ripples = tuple(c for c in every if order_of(c) is not None)
    library = {c: data.map(partial(columns_of, c)) for c in every if order_of(c) is None}
    axis = axis_side(arm, sight.samples[:first], sight.samples[first:], parts=parts)
    of_axis, base = [from_axis(one, arm) for one in axis.causes] if axis else [], arm
    if of_axis:
        # the search is left with what they leave
        base = sharply(arm, sight.samples)
        runs = [replace(run, arm=base) for run in runs]
        terms = extend(base, of_axis).effects[len(arm.effects) :]
        data = Split(dataset_of(runs[:first]), dataset_of(runs[first:]), parts)
        data = data.map(lambda part: replace(part, y=dataset_with(part, terms)))
    free = [Split(*pair) for pair in zip(free_columns(data.fit, arm), free_columns(data.held_out, arm))]
    searched, waves = (library, ripples) if axis is None else ({}, ())
    model = Currents(arm, data, searched, free, waves, banned)
    refused: list[EffectKey] = []
    found = search(model, progress)
    while True:
        progress("estimating parameters")
        causes = _of_search(found)
        progress("judging in closed loop")
        if (removed := _untenable(arm, causes, held_out, runs[first:])) is None:
            break
        candidate = found.state.chosen[removed]
        refused.append(candidate.key)
        if len(refused) <= LIMITS.searched_again:
            # what it stood for may have a better name
            found = search(replace(model, excluded=banned | set(refused)), progress)
        else:
            found = without(found, candidate)
    return Named(
        arm=arm,
        sight=sight,
        base=base,
        library=library,
        ripples=waves,
        found=found,
        axis=axis,
        causes=causes + of_axis,
    )


def _swung(named: Named, fit: Sequence[Recording], held_out: Sequence[Recording]) -> Cause | None:
    """A spring or play that closed loops show, in the place of one that the search named or beside all that it named."""
    springs: list[Cause | None] = [one for one in named.causes if one.effect in resonance.transmissions()]
    for spring in springs or [None]:
        arm = with_widths(extend(named.base, [one for one in named.causes if one is not spring]), fit)
        joints = [spring.joint] if spring and spring.joint else range(1, len(arm) + 1)
        if (cause := resonance.swinging(arm, fit, held_out, joints, spring)) is not None:
            return cause
    return None


def has_dynamics(arm: Arm) -> bool:
    """Whether the model expects any torque at all."""
    return any(joint.mass or joint.rotor_inertia or any(joint.coulomb) or any(joint.viscous) for joint in arm.joints)


def _of_search(found: Found) -> list[Cause]:
    """The causes that a search found, in its order, with parameters."""
    state = found.state
    return [of_candidate(c, values, state) for c, values in zip(state.chosen, estimates_of(state))]


def _indistinct(causes: Sequence[Cause]) -> int | None:
    """The first cause none of whose sizes is told from nothing: it follows something, but is not there.

    A link's many parameters need not be told from nothing one by one: together they are.
    """
    for index, cause in enumerate(causes):
        sizes = {p.name for p in CATALOGUE[cause.effect].linear}
        values = [p for p in cause.parameters if p.name in sizes]
        if 0 < len(values) < LIMITS.few_sizes and all(abs(p.value) < LIMITS.significant_sizes * p.std for p in values):
            return index
    return None


def _untenable(arm: Arm, causes: list[Cause], recordings: Sequence[Recording], runs: Sequence[Run]) -> int | None:
    """The first cause that is not told from nothing, or that the closed loop refutes."""
    indistinct = _indistinct(causes)
    if indistinct is not None or not causes:
        return indistinct
    full = with_widths(extend(arm, causes), recordings)
    widths = [joint.sign_velocity for joint in full.joints]
    less = [extend(arm, [one for one in causes if one is not cause]) for cause in causes]
    turned = [
        replace(one, joints=tuple(replace(joint, sign_velocity=w) for joint, w in zip(one.joints, widths)))
        for one in less
    ]
    return refuted(full, turned, [cause.felt_at or 1 for cause in causes], recordings, runs)
