"""The search for causes in the currents.

Stepwise selection, refinement by the exact model, simplification, and comparison with unexplained structure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.refinement import gauss_newton_refined
from diagnosis.measurements.currents.simplification import simplified
from diagnosis.measurements.currents.state import State, corrected
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.spurious import spurious
from diagnosis.measurements.currents.structure.unexplained import Unexplained, unexplained_structure
from diagnosis.selection.bodies import bodies_of_link, is_body, link_of
from diagnosis.selection.candidate import Candidate
from identification.selection import Score, eliminate, select


@dataclass(frozen=True)
class Selection:
    """The chosen candidates, and the unexplained structure conditional on them."""

    state: State
    unexplained: Unexplained


def search(model: Currents, progress: Callable[[str], None]) -> State:
    """Candidates that explain the residual together."""
    state = simplified(attributed_to_body(gauss_newton_refined(select(model, progress))))
    if len(fewer := eliminate(model, state).chosen) < len(state.chosen):
        state = model.refitted(fewer, state.rivals)
    return state


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
            possible = body.key not in model.excluded and is_body(
                estimates_of(as_body)[-1], model.limits.body_deviations
            )
            if possible or c.body:
                return as_body if possible else _in_place(state, (*chosen, link), link, rivals)
    return state


def _in_place(state: State, chosen: Sequence[Candidate], last: Candidate, rivals: Sequence[Score[Candidate]]) -> State:
    return state.model.refitted(chosen, {**state.rivals, last.key: rivals})


def without(state: State, removed: Candidate) -> State:
    """A state less one candidate, the others fitted anew."""
    return state.model.refitted([c for c in state.chosen if c is not removed], state.rivals)


def without_spurious(state: State, bases: Bases) -> Selection:
    """The causes of a state that are no names for parts of unexplained structure, and that structure.

    bases: of the recordings of the state.
    """
    selection = _with_unexplained(state, bases)
    while withdrawn := spurious(selection.state, selection.unexplained, bases):
        state = corrected(replace(state, chosen=tuple(c for c in state.chosen if c not in withdrawn)))
        selection = _with_unexplained(state, bases)
    return selection


def _with_unexplained(state: State, bases: Bases) -> Selection:
    return Selection(state, unexplained_structure(state.data, state.fitted, state.model.arm, state.significance, bases))
