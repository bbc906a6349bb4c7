"""The search for causes in the currents.

Stepwise selection, refinement by the exact model, simplification, and comparison with unexplained structure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from diagnosis.cause import EffectKey, Structure
from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.possible import exists, is_physical
from diagnosis.measurements.currents.refinement import gauss_newton_refined
from diagnosis.measurements.currents.replacement.simplified import simplified
from diagnosis.measurements.currents.state import State, corrected
from diagnosis.measurements.currents.structure.coefficient_doubt import CoefficientDoubt
from diagnosis.measurements.currents.structure.noise_ratio import joints_above_noise
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.spurious import of_another_order, spurious
from diagnosis.measurements.currents.structure.unexplained import StructureSearch, Unexplained
from diagnosis.selection.bodies import bodies_of_link, is_body, link_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.regression import fit_gain
from identification.selection import Score, eliminate, select


@dataclass(frozen=True)
class Selection:
    """The chosen candidates, and the unexplained structure conditional on them.

    refuted: what is unexplained in the place of causes whose law is not the leading order (``of_another_order``).
    """

    state: State
    unexplained: Unexplained
    refuted: Mapping[EffectKey, Structure] = field(default_factory=dict)


def search(model: Currents, progress: Callable[[str], None]) -> State:
    """Candidates that explain the residual together.

    A law of many coefficients keeps out what it follows itself. Where it is replaced or removed in the end, and a joint
    is above the noise, the search goes on from there.
    """
    selected = select(model, progress)
    state = _refined(selected)
    if set(state.chosen) != set(selected.chosen) and above_noise(state):
        further = select(model, progress, state)
        if (
            set(further.chosen) != set(state.chosen)
            and (again := _refined(further)).energy.held_out < state.energy.held_out
        ):
            state = again
    return state


def _refined(selected: State) -> State:
    """What was selected, refined by the exact model, without what simpler causes or none do as well."""
    model, state = selected.model, simplified(attributed_to_body(gauss_newton_refined(selected)))
    if len(fewer := eliminate(model, state).chosen) < len(state.chosen):
        state = model.refitted(fewer, state.rivals)
    return state


def above_noise(state: State) -> bool:
    """Whether the residual of a joint is above the noise, in fitted or in held-out recordings."""
    return any(joints_above_noise(left, side, state.model.arm) for left, side in zip(state.residual, state.data))


def by_fitted_rows(state: State) -> State:
    """The state with the effect that the fitted rows show best at each joint above the noise, if it is most of it.

    Whatever held-out rows say: where some of them are not where they belong, they contradict the effect that is there.
    """
    held_out, fit, model = state.data.held_out, state.data.fit, state.model
    joints = joints_above_noise(state.residual.held_out, held_out, model.arm)
    best: dict[int, tuple[float, Candidate]] = {}
    for c in (score.candidate for score in (model.scores(state) if joints else ())):
        if c.joint in joints and c.key not in model.taken(state):
            gain, coefficients = fit_gain(model.columns(c).fit, state.fitted)
            if is_physical(c, coefficients):
                best[c.joint] = max(best.get(c.joint, (0.0, c)), (gain, c), key=lambda one: one[0])
    left = fit.by_joint(state.residual.fit**2)
    more = [c for joint, (gain, c) in best.items() if gain > LIMITS.swapped * left[joint - 1]]
    shown = model.refitted([*state.chosen, *more], {**state.rivals, **{c.key: () for c in more}}) if more else state
    return shown if exists(model.arm, shown.terms) else state


def attributed_to_body(state: State) -> State:
    """The state with a body in place of the change of the link that carries it, or the reverse, as its values allow.

    Both have the same columns (``diagnosis.selection.bodies``).
    """
    model = state.model
    for c in state.chosen:
        link = link_of(c, model.arm) if c.body else c
        for body in bodies_of_link(link, model.arm):
            chosen = [one for one in state.chosen if one not in (link, c) and one.key != body.key]
            rivals = [one for key in (body.key, link.key) for one in state.rivals.get(key, ())]
            as_body = _in_place(state, (*chosen, body), body, rivals)
            possible = body.key not in model.excluded and is_body(estimates_of(as_body)[-1], LIMITS.body_deviations)
            if possible or c.body:
                return as_body if possible else _in_place(state, (*chosen, link), link, rivals)
    return state


def _in_place(state: State, chosen: Sequence[Candidate], last: Candidate, rivals: Sequence[Score[Candidate]]) -> State:
    return state.model.refitted(chosen, {**state.rivals, last.key: rivals})


def refitted_without(state: State, removed: Candidate) -> State:
    """A state less one candidate, the others fitted anew."""
    return state.model.refitted([c for c in state.chosen if c is not removed], state.rivals)


def without_spurious(state: State, bases: Bases, refuted: Mapping[EffectKey, Structure] | None = None) -> Selection:
    """The causes of a state that are no names for parts of unexplained structure, and that structure.

    bases: of the recordings of the state; refuted: of a state with more causes.
    """
    selection, refuted = _with_unexplained(state, bases), dict(refuted or {})
    while True:
        withdrawn = spurious(selection.state, selection.unexplained, bases)
        if not withdrawn and (other := of_another_order(selection.state)) is not None:
            withdrawn, structure = other
            refuted |= {candidate.key: structure for candidate in withdrawn}
        if not withdrawn:
            return _with_refuted(selection, refuted)
        state = corrected(replace(state, chosen=tuple(c for c in state.chosen if c not in withdrawn)))
        selection = _with_unexplained(state, bases)


def _with_refuted(selection: Selection, refuted: Mapping[EffectKey, Structure]) -> Selection:
    """The selection with the structure of refuted causes, in the place of any that explains less of their joints."""
    shares = {structure.joint: structure.share for structure in refuted.values()}
    larger = [one for one in selection.unexplained.structures if one.share >= shares.get(one.joint, 0.0)]
    named = {(one.joint, one.against) for one in larger}
    own = [one for one in dict.fromkeys(refuted.values()) if (one.joint, one.against) not in named]
    return replace(selection, unexplained=replace(selection.unexplained, structures=[*larger, *own]), refuted=refuted)


def _with_unexplained(state: State, bases: Bases) -> Selection:
    beside = CoefficientDoubt(state).beside
    search = StructureSearch(state.data, state.fitted, state.model.arm, state.significance, bases, beside)
    return Selection(state, search.of_all_joints())
