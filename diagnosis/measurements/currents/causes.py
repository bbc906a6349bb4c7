"""Causes that the currents show: those of the search, events in raw rows, and those of a single axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, Joint
from arm_model.effects import CATALOGUE, Instrument
from diagnosis.cause import Cause, EffectKey, Estimate, Signal, confidence_of
from diagnosis.cause.units import fall
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.refinement import refined
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.noise_ratio import joints_above_noise
from diagnosis.measurements.single_axis.causes import AxisCause
from diagnosis.screening.event import Event, Gain
from diagnosis.selection.aliasing import confusability, span_of
from diagnosis.selection.bodies import bodies_of_link
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from diagnosis.selection.friction_shares import with_shares
from diagnosis.selection.regression import Fitted, score
from diagnosis.selection.ripple_orders import in_words
from identification import recorded_quantity
from identification.selection import Split

BY_DIRECTION = {"positive", "negative", "viscous_positive", "viscous_negative"}
"""Parameters that together are the friction of an axis per direction."""


def of_candidate(candidate: Candidate, values: list[Estimate], state: State) -> Cause:
    """A chosen candidate as a cause, with its evidence and ambiguity group."""
    model, held_out = state.model, state.data.held_out
    others = model.without(candidate, state).fitted
    residuals = others.residual.held_out, state.residual.held_out
    conditional = score(candidate, model.columns(candidate), others, held_out)
    joint = candidate.joint or _most_felt(*residuals, held_out)
    drive = model.arm.joints[joint - 1]
    before, after = (_rms_in_amperes(residual, held_out, joint) for residual in residuals)
    turn = in_words(candidate, drive)
    better, compared = (int(np.sum(blocks)) for blocks in (conditional.blocks > 0, conditional.blocks != 0))
    sentence = (
        f"{candidate.definition.shows}{f' ({turn})' if turn else ''}: with it, the held-out {recorded_quantity(drive)} "
        f"error of joint {joint} falls {fall(before, after, drive.command_unit)}, in {better} of "
        f"{compared} one-second blocks of {f'joint {candidate.joint}' if candidate.joint else 'all joints'}"
    )
    group = _ambiguity_group(candidate, others, state)
    confused_with = candidate.definition.confused_with
    return Cause(
        effect=candidate.effect,
        joint=candidate.joint,
        parameters=with_shares(candidate.effect, values, drive),
        confidence=confidence_of(conditional.p),
        before=before,
        after=after,
        group=group,
        separate_by=next((confused_with[effect] for effect, _ in group[1:] if effect in confused_with), None),
        evidence=sentence,
        felt_at=joint,
        unit=drive.command_unit,
    )


def _ambiguity_group(candidate: Candidate, others: Fitted, state: State) -> tuple[EffectKey, ...]:
    """The candidate, its aliases, and the rivals that this data does not distinguish from it.

    Aliases that differ only while the drives are off count as equal if no recording has them off.
    """
    definition = candidate.definition
    aliases = [*definition.aliases]
    if all(run.powered for run in state.all_runs):
        aliases += definition.observed_by[Instrument.CURRENT].aliases
    keys = [
        candidate.key,
        *_indistinguishable(candidate, others, state),
        *_bodies_of_unknown_mass(candidate, state),
        *((name, candidate.joint) for name in aliases),
    ]
    return tuple(dict.fromkeys(keys))


def _indistinguishable(candidate: Candidate, others: Fitted, state: State) -> list[EffectKey]:
    """Rivals whose columns this data does not distinguish from the candidate's, conditional on all others."""
    model, rows = state.model, len(state.data.fit.y)
    basis = span_of(others.basis)
    own = model.columns(candidate).fit.dense(rows)
    return [
        rival.candidate.key
        for rival in state.rivals[candidate.key]
        if rival.candidate.key != candidate.key
        and candidate.effect not in rival.candidate.definition.special_cases
        and confusability(basis, own, model.columns(rival.candidate).fit.dense(rows)) > LIMITS.group_correlation
        and not _refuted(rival.candidate, candidate, others, state)
    ]


def _refuted(rival: Candidate, candidate: Candidate, others: Fitted, state: State) -> bool:
    """Whether recordings without noise contradict a rival.

    In the place of the candidate, in the exact model, it leaves a joint above the noise that the candidate does not.
    """
    model, arm = state.model, state.model.arm
    if not any(run.without_noise for run in state.all_runs):
        return False
    sharp = refined(rival, others, model.data.fit)
    chosen = [sharp if c is candidate else c for c in state.chosen]
    in_place = model.refitted(chosen, {**state.rivals, sharp.key: ()})
    return any(
        set(joints_above_noise(of_rival, side, arm)) - set(joints_above_noise(own, side, arm))
        for of_rival, own, side in zip(in_place.residual, state.residual, state.data)
    )


def _bodies_of_unknown_mass(candidate: Candidate, state: State) -> list[EffectKey]:
    """Bodies that a change of their link may be as well, where nothing shows its mass: of a single axis, say."""
    bodies = bodies_of_link(candidate, state.model.arm)
    if not bodies:
        return []
    lengths = np.linalg.norm(state.model.columns(candidate).fit.x, axis=0)
    return [body.key for body in bodies] if lengths[0] < LIMITS.independent * lengths.max() else []


def _most_felt(before: Array, after: Array, side: Dataset) -> int:
    """Joint (from 1) whose residual falls most."""
    return int(np.argmax(side.by_joint(before**2 - after**2))) + 1


def _rms_in_amperes(whitened: Array, side: Dataset, joint: int) -> float:
    """A: rms of a joint's residual over the rows that are compared."""
    rows = side.comparable(joint)
    values = (whitened[side.of(joint)] * side.at_joint("deviation", joint))[rows] if rows.any() else np.zeros(1)
    return float(np.sqrt(np.mean(values**2)))


def from_event(event: Event, arm: Arm, data: Split[Dataset]) -> Cause:
    """An event of raw rows as a cause; without a gain of its own, before and after are the noise of the currents."""
    joint = event.joint or (event.gain.joint if event.gain else 1)
    noise = float(np.mean([run.noise[joint - 1] for run in data.held_out.runs]))
    gain = event.gain or Gain(before=noise, after=noise, unit="A", joint=joint)
    felt = arm.joints[gain.joint - 1]

    def stated(values: list[Estimate], at: Joint) -> list[Estimate]:
        return [replace(p, unit=at.unit(p.unit, p.name)) for p in values]

    return Cause(
        effect=event.effect,
        joint=event.joint,
        parameters=stated(event.parameters, felt),
        confidence=confidence_of(gain.p),
        before=gain.before,
        after=gain.after,
        group=((event.effect, event.joint),),
        evidence=event.evidence,
        felt_at=gain.joint,
        unit=felt.unit(gain.unit),
        signal=Signal.CURRENT if gain.unit == "A" else Signal.ANGLE,
        of_arm=all(observation.of_arm for observation in CATALOGUE[event.effect].observed_by.values()),
        of_joints={j: stated(values, arm.joints[j - 1]) for j, values in event.of_joints.items()},
        lost_rows=event.lost_rows,
        encoder_jumps=event.encoder_jumps,
    )


def from_axis(axis_cause: AxisCause, arm: Arm) -> Cause:
    """A cause of a single axis in the words and units of its drive."""
    effect, drive = CATALOGUE[axis_cause.effect], arm.joints[0]
    values = {p.name: p.value for p in axis_cause.parameters}
    units = {p.name: drive.unit(p.unit, p.name) for p in effect.parameters}
    sentence = (
        f"{effect.shown(Instrument.SINGLE_AXIS, values, units)}: with it, the held-out error of the command below 60 "
        f"Hz falls {fall(axis_cause.before, axis_cause.after, drive.command_unit)}, in "
        f"{int(np.sum(axis_cause.gains > 0))} of {len(axis_cause.gains)} blocks"
    )
    if set(values) >= BY_DIRECTION:
        sentence += f"; {_by_direction(arm, values)}"
    return Cause(
        effect=axis_cause.effect,
        joint=_joint_of(axis_cause.effect),
        parameters=with_shares(axis_cause.effect, axis_cause.parameters, drive),
        confidence=confidence_of(axis_cause.p),
        before=axis_cause.before,
        after=axis_cause.after,
        group=tuple((name, _joint_of(name)) for name in axis_cause.group),
        separate_by=next(
            (effect.confused_with[name] for name in axis_cause.group[1:] if name in effect.confused_with), None
        ),
        evidence=sentence,
        felt_at=1,
        unit=drive.command_unit,
        deviations=axis_cause.deviations,
    )


def _joint_of(effect: str) -> int | None:
    """Of a single axis: 1, or None for an effect of the whole arm."""
    return 1 if CATALOGUE[effect].per_joint else None


def _by_direction(arm: Arm, more: Mapping[str, float]) -> str:
    """Total friction of one axis in words: that of the model and ``more``.

    A constant offset of the model acts as friction that differs by direction while the axis moves.
    """
    drive = arm.joints[0]
    step, slope = drive.unit("N m"), drive.unit("N m s/rad")
    offset = drive.ratio * drive.offset
    by_direction = [
        f"{drive.ratio * drive.coulomb[k] + more[side] + sign * offset:.4g} {step} and "
        f"{drive.ratio**2 * drive.viscous[k] + more[f'viscous_{side}']:.4g} {slope} {way}"
        for k, (side, sign, way) in enumerate((("positive", 1.0, "forwards"), ("negative", -1.0, "backwards")))
    ]
    return f"total friction is then {', '.join(by_direction)}" + (
        " (with the constant offset of the model)" if offset else ""
    )
