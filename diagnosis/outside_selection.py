"""Causes found outside the stepwise selection: friction near rest, lost rows and transmissions in loop, chatter."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence, Set
from dataclasses import replace

from arm_model import Arm
from arm_model.effects import CATALOGUE, Variable
from diagnosis.cause import Cause, EffectKey, extend
from diagnosis.closed_loop.comparison import with_smoothing_velocities
from diagnosis.closed_loop.friction import friction_in_loop, has_state, with_estimates_of
from diagnosis.closed_loop.lost_rows import LostInLoop, lost_in_loop
from diagnosis.closed_loop.resonance import transmission_resonance, transmissions
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.measurements.currents.chatter import chattering_gaps
from diagnosis.measurements.currents.structure.basis_functions import TWO_FACED
from diagnosis.measurements.near_rest.friction import Friction, friction_causes
from diagnosis.measurements.near_rest.passages import coarse


def friction_near_rest(currents: CurrentDiagnosis, recordings: Recordings, excluded: Set[EffectKey]) -> Friction:
    """Friction that shows where joints turn or creep, conditional on what the selection chose.

    Of an identified model by currents alone, beyond what it left there when identified (``Observation.model_std``).
    """
    state = currents.state
    if not currents.by_selection:
        return Friction([], [])
    taken = [*excluded, *(cause.key for cause in currents.causes)]
    # friction near rest is judged conditional on any function of load and position, which are other laws
    nuisance: dict[int, list[Variable]] = {}
    for one in currents.selection.unexplained.structures:
        if one.joint is not None and one.against in TWO_FACED:
            nuisance.setdefault(one.joint, []).append(Variable(one.against))
    at_rest = friction_causes(state.runs, state.terms, taken, tuple(currents.library), nuisance)
    if not currents.by_exact_model:
        return at_rest
    in_loop = _in_loop(currents, recordings, [*taken, *(cause.key for cause in at_rest.causes)])
    return replace(at_rest, causes=[*at_rest.causes, *in_loop])


def friction_in_place(currents: CurrentDiagnosis, excluded: Set[EffectKey]) -> list[Cause]:
    """Laws of friction near rest in the place of all that the selection chose at their joints.

    The selection adds one effect after the other, of columns that are linear in a coefficient. Friction that builds up
    over a distance has none, and joints that turn often imitate it by the sum of several. Where the selection names it,
    it has the stiffness alone: the damping shows in the closed loop, and is estimated from the passages through rest.
    """
    state = currents.state
    named = Counter(cause.joint for cause in currents.causes if cause.joint is not None)
    joints = {cause.joint for cause in currents.causes if cause.joint and has_state(cause.effect)}
    joints |= {joint for joint, count in named.items() if count > 1}
    if not (currents.by_selection and joints):
        return []
    found = list[Cause]()
    for joint in joints:
        others = [term for term in state.terms if term.joint != joint]
        taken = [*excluded, *(cause.key for cause in currents.causes if cause.joint != joint)]
        found += friction_causes(state.runs, others, taken, tuple(currents.library), joints=[joint]).causes
    return found


def _in_loop(currents: CurrentDiagnosis, recordings: Recordings, taken: Sequence[EffectKey]) -> list[Cause]:
    """Friction near rest judged by closed loops, for joints whose encoder is too coarse for judging the currents there.

    What the search by currents named there is judged again, and estimated from both.
    """
    runs = currents.state.all_runs
    joints = [j for j in range(1, len(currents.arm) + 1) if all(coarse(run, j) for run in runs)]
    if not joints:
        return []
    every = [
        replace(r, q=q, i=i)
        for r, (_, q, i) in zip((*recordings.fit, *recordings.held_out), currents.residuals.samples)
    ]
    again = {cause.key: cause for cause in currents.causes if cause.joint in joints and has_state(cause.effect)}
    others = [cause for cause in currents.causes if cause.key not in again]
    in_loop = friction_in_loop(extend(currents.base, others), every, joints, set(taken) - set(again))
    return [with_estimates_of(cause, again[cause.key]) if cause.key in again else cause for cause in in_loop]


def resonance_in_loop(currents: CurrentDiagnosis, recordings: Recordings, known: Sequence[Cause] = ()) -> Cause | None:
    """A spring or a gap that closed loops show: in the place of one that the search named, or in addition.

    Also at another joint than all that the search named: along the motion, a joint follows its neighbour's oscillation,
    and may seem to have the spring. known: transmissions of the model that closed loops have shown before.
    """
    springs = [one for one in currents.causes if one.effect in transmissions()]
    others = [one for one in currents.causes if one not in springs]
    joints = set(range(1, len(currents.arm) + 1)) - {one.joint for one in known}

    def searched(causes: Sequence[Cause], joints: Collection[int], near: Cause | None) -> Cause | None:
        arm = with_smoothing_velocities(extend(currents.base, causes), recordings.fit)
        return transmission_resonance(arm, recordings.fit, recordings.held_out, sorted(joints), near)

    for spring in springs:
        if spring.joint in joints:
            beside = [one for one in currents.causes if one is not spring]
            if (cause := searched(beside, {spring.joint}, spring)) is not None:
                return cause
    return searched(others, joints - {one.joint for one in springs}, None)


def transmission_in_place(arm: Arm, recordings: Recordings, of: Cause) -> Cause | None:
    """The same transmission estimated again in closed loops of an arm that lacks it; None if they show another."""
    arm = with_smoothing_velocities(arm, recordings.fit)
    again = transmission_resonance(arm, recordings.fit, recordings.held_out, [of.joint] if of.joint else [], of)
    return again if again is not None and again.key == of.key else None


def rows_lost_in_loop(currents: CurrentDiagnosis, recordings: Recordings) -> LostInLoop | None:
    """Rows of currents that closed loops show to be lost, in recordings that have not been realigned yet."""
    if not currents.by_exact_model:
        return None
    arm = with_smoothing_velocities(extend(currents.base, currents.causes), recordings.fit)
    lost = lost_in_loop(arm, recordings.fit, recordings.held_out, [i for _, _, i in currents.residuals.samples])
    put_back = {loss.recording for loss in currents.residuals.losses}
    losses = [loss for loss in lost.losses if loss.recording not in put_back] if lost else []
    return replace(lost, losses=losses) if lost and losses else None


def gaps(currents: CurrentDiagnosis, excluded: Set[EffectKey]) -> tuple[Cause, ...]:
    """The gaps that the search named, and those whose teeth chatter."""
    if currents.axis:
        return ()
    chosen_gaps = tuple(cause for cause in currents.causes if CATALOGUE[cause.effect].gap is not None)
    if not currents.by_exact_model:
        return chosen_gaps
    state, taken = currents.state, {*excluded, *(cause.key for cause in currents.causes)}
    return (*chosen_gaps, *chattering_gaps(state.runs, state.terms, taken))
