"""What a reader of a diagnosis should know beside its causes: sentences on recordings, model and extended model."""

from __future__ import annotations

from collections.abc import Iterator

from arm_model import Arm
from arm_model.effects import CATALOGUE
from diagnosis.current_diagnosis import CurrentDiagnosis
from diagnosis.measurements.single_axis.remarks import remarks
from diagnosis.other_instruments import OtherInstruments
from diagnosis.remainder.fitted_only import not_held_out
from diagnosis.residual.folding_warnings import folding_warnings
from diagnosis.residual.warmth import reference_taken
from diagnosis.screening.plausibility import mixed_up
from diagnosis.unexplained import unexplained_of_currents
from identification import recorded_signals, without_rotors


def warnings_of(arm: Arm, instruments: OtherInstruments, currents: CurrentDiagnosis) -> Iterator[str]:
    """What a reader of the result should know about the recordings and the model."""
    state, of_currents = currents.state, unexplained_of_currents(instruments, currents)
    if instruments.judged:
        yield from mixed_up(state.all_runs)
        yield from folding_warnings(state.all_runs)
        yield from not_held_out(state.residual.fit, state.data.fit, of_currents, state.significance.allowed.fit)
        if of_currents and (sentence := without_rotors(arm)):
            yield sentence
        yield from _without_friction(arm, currents)
    else:
        yield f"{arm.name} has neither masses nor friction: its {recorded_signals(arm)} were not judged"
    for uncertainty, subject in ((arm.uncertainty, "parameters are"), (arm.kinematic_uncertainty, "geometry is")):
        if uncertainty is not None and not uncertainty.parameters:
            yield f"the model names {uncertainty.file}, which is not in its folder: its {subject} taken as exact"
    if instruments.judged and arm.uncertainty is not None and not arm.uncertainty.near_rest:
        yield (
            f"friction near rest was not judged: {arm.uncertainty.file} has no entry left_over_near_rest; "
            "identify the arm again with this version of armscope to get one"
        )
    yield from reference_taken(arm, [cause.key for cause in currents.causes], state.data.fit.runs)
    yield from _smoothing_replaced(arm, currents.base)
    yield from remarks(currents.axis, arm.joints[0]) if currents.axis else ()
    yield from instruments.link.remarks if instruments.link else ()


def _without_friction(arm: Arm, currents: CurrentDiagnosis) -> Iterator[str]:
    """A sentence where a model without friction, as a URDF file may leave it, has causes at most of its joints."""
    if any(max(*joint.rest_friction, *joint.viscous) > 0.0 for joint in arm.joints):
        return
    joints = {cause.joint for cause in currents.causes if cause.joint is not None}
    if 2 * len(joints) > len(arm):
        yield (
            "the model states no friction of any joint, so that all friction of the arm is told as a cause: identify "
            "the arm first (`armscope identify`), and diagnose other recordings with the model that this writes"
        )


def replaced(as_found: Arm, extended: Arm) -> Iterator[str]:
    """Sentences on where the ``extended`` model differs from the causes, and on whether it can be simulated.

    as_found: the model with the causes as they are named.
    """
    yield from _friction_replaced(as_found, extended)
    yield from _smoothing_replaced(as_found, extended)
    yield from not_simulated(extended)


def _smoothing_replaced(model: Arm, base: Arm) -> Iterator[str]:
    """A sentence per joint whose Coulomb smoothing velocity is not that of the model."""
    for number, (joint, changed) in enumerate(zip(model.joints, base.joints), 1):
        if changed.sign_velocity != joint.sign_velocity:
            of = f" of joint {number}" if len(model) > 1 else ""
            yield (
                f"Coulomb smoothing velocity{of} set to {changed.sign_velocity:.2g} "
                f"instead of {joint.sign_velocity:.2g} {joint.unit('rad/s')}"
            )


def _friction_replaced(stated: Arm, extended: Arm) -> Iterator[str]:
    """A sentence per joint whose friction would drive it with the causes as stated: the extended model has another."""
    for number, (before, after) in enumerate(zip(stated.joints, extended.joints), 1):
        if (before.coulomb, before.viscous) != (after.coulomb, after.viscous):
            yield (
                f"with the causes as named, friction would drive joint {number} at some speed: the extended model has "
                "the nearest friction that opposes the motion at every speed"
            )


def not_simulated(extended: Arm) -> Iterator[str]:
    """A sentence per transmission at a joint whose drive has no rotor inertia, as a URDF file leaves it.

    Measured angles show its deflection all the same; a simulation needs a mass on the side of the motor.
    """
    for term in extended.effects:
        if term.joint is None or CATALOGUE[term.name].spring is None:
            continue
        if extended.joints[term.joint - 1].rotor_inertia <= 0.0:
            yield (
                f"the extended model cannot be simulated: {term.name.replace('_', ' ')} of joint {term.joint} needs a "
                "rotor_inertia of that joint; give it one"
            )
