"""Causes that show beside the search: friction near rest, lost rows and transmissions in closed loop, chatter."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace

from arm_model.effects import CATALOGUE, Variable
from diagnosis.cause import Cause, EffectKey, extend
from diagnosis.closed_loop.comparison import with_smoothing_velocities
from diagnosis.closed_loop.friction import friction_in_loop, has_state, with_estimates_of
from diagnosis.closed_loop.lost_rows import LostInLoop, lost_in_loop
from diagnosis.closed_loop.resonance import transmission_resonance, transmissions
from diagnosis.measurements.currents.chatter import chattering_gaps
from diagnosis.measurements.currents.structure.basis_functions import TWO_FACED
from diagnosis.measurements.near_rest.friction import Friction, friction_causes
from diagnosis.measurements.near_rest.passages import coarse
from diagnosis.named import Named, Recordings


def friction_near_rest(named: Named, recordings: Recordings, excluded: Set[EffectKey]) -> Friction:
    """Friction that shows where joints turn or creep, beside what the search named.

    Of an identified model beyond what it left there when it was identified (``Seen.doubt``), and by currents alone.
    """
    state = named.found.state
    if named.axis or not named.library:
        return Friction([], [])
    taken = [*excluded, *(cause.key for cause in named.causes)]
    # what load or position predict is another law: friction is judged beside any function of them
    given: dict[int, list[Variable]] = {}
    for one in named.found.unexplained.structures:
        if one.joint is not None and one.against in TWO_FACED:
            given.setdefault(one.joint, []).append(Variable(one.against))
    found = friction_causes(state.data.map(lambda part: part.runs), state.terms, taken, tuple(named.library), given)
    if named.arm.uncertainty is not None:
        return found
    in_loop = _in_loop(named, recordings, [*taken, *(cause.key for cause in found.causes)])
    return replace(found, causes=[*found.causes, *in_loop])


def _in_loop(named: Named, recordings: Recordings, taken: Sequence[EffectKey]) -> list[Cause]:
    """The same by closed loops, at joints whose encoder hardly shows the speed that currents are judged at.

    What the search named there of currents is judged again, and estimated by both.
    """
    runs = [run for part in named.found.state.data for run in part.runs]
    joints = [j for j in range(1, len(named.arm) + 1) if all(coarse(run, j) for run in runs)]
    if not joints:
        return []
    every = [
        replace(r, q=q, i=i) for r, (_, q, i) in zip((*recordings.fit, *recordings.held_out), named.residuals.samples)
    ]
    again = {cause.key: cause for cause in named.causes if cause.joint in joints and has_state(cause.effect)}
    beside = [cause for cause in named.causes if cause.key not in again]
    found = friction_in_loop(extend(named.base, beside), every, joints, set(taken) - set(again))
    return [with_estimates_of(cause, again[cause.key]) if cause.key in again else cause for cause in found]


def resonance_in_loop(named: Named, recordings: Recordings) -> Cause | None:
    """A spring or a gap that closed loops show: in the place of one that the search named, or in addition."""
    springs: list[Cause | None] = [one for one in named.causes if one.effect in transmissions()]
    for spring in springs or [None]:
        arm = with_smoothing_velocities(
            extend(named.base, [one for one in named.causes if one is not spring]), recordings.fit
        )
        joints = [spring.joint] if spring and spring.joint else range(1, len(arm) + 1)
        if (cause := transmission_resonance(arm, recordings.fit, recordings.held_out, joints, spring)) is not None:
            return cause
    return None


def rows_lost_in_loop(named: Named, recordings: Recordings) -> LostInLoop | None:
    """Rows of currents that closed loops show to be lost, of recordings that no search has put back."""
    if named.axis or named.arm.uncertainty is not None or not named.library:
        return None
    arm = with_smoothing_velocities(extend(named.base, named.causes), recordings.fit)
    found = lost_in_loop(arm, recordings.fit, recordings.held_out, [i for _, _, i in named.residuals.samples])
    put_back = {loss.recording for loss in named.residuals.losses}
    losses = [loss for loss in found.losses if loss.recording not in put_back] if found else []
    return replace(found, losses=losses) if found and losses else None


def gaps(named: Named, excluded: Set[EffectKey]) -> tuple[Cause, ...]:
    """The gaps that the search named, and those whose teeth chatter.

    Of an arm whose model is exact: an error of its load moves the instant at which teeth part.
    """
    if named.axis:
        return ()
    found = tuple(one for one in named.causes if CATALOGUE[one.effect].gap is not None)
    if named.arm.uncertainty is not None or not named.library:
        return found
    state, taken = named.found.state, {*excluded, *(cause.key for cause in named.causes)}
    return (*found, *chattering_gaps(state.data.map(lambda part: part.runs), state.terms, taken))
