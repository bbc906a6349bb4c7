"""From recordings and a model to causes: screen, measure, select, verify, extend.

screen   events in raw rows are found and removed (``screening``)
measure  what tracker, link encoders and setpoints show without the currents (``other_instruments``)
select   what the currents show conditional on it (``find_causes``): residuals, columns of every effect, stepwise
         selection, unexplained structure
verify   the extended model in closed loop and along the measured motion (``verified``)
extend   all causes together, the extended model, and what remains unexplained (``unexplained``)

All of it is the ``result``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm
from arm_model.effects import dissipative
from daq.recording import Recording
from diagnosis.another_day import known_in
from diagnosis.cause import Cause, Structure, extend, merge
from diagnosis.closed_loop.comparison import with_smoothing_velocities
from diagnosis.confidence import with_confidence
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.damping_by_currents import links_damped, tracked_damped
from diagnosis.find_causes import find_causes
from diagnosis.isolated_by_currents import isolated_by_currents
from diagnosis.measurements.currents.causes import from_event
from diagnosis.measurements.single_axis.remarks import remarks
from diagnosis.other_held_out import better, other_roles
from diagnosis.other_instruments import OtherInstruments, measure, tracked_beside
from diagnosis.remainder.against_noise import ratios
from diagnosis.remainder.fitted_only import not_held_out
from diagnosis.remainder.of_identification import allowed_residuals, left_over
from diagnosis.residual.folding_warnings import folding_warnings
from diagnosis.residual.noise.channels import angle_noise
from diagnosis.residual.other_effects import with_own
from diagnosis.residual.warmth import reference_taken, with_needed_reference, with_reference
from diagnosis.result import Diagnosis
from diagnosis.screening.cleaned import Screened, screened
from diagnosis.screening.even_rows import even, even_samples, known_noise
from diagnosis.screening.event import Event
from diagnosis.screening.lost_rows.blank_samples import without_blanks
from diagnosis.screening.plausibility import check, check_motion, mixed_up
from diagnosis.screening.residuals import with_aligned_currents
from diagnosis.unexplained import undetectable, unexplained_of_currents, unexplained_structure
from diagnosis.verification.held_currents import remarks_on
from diagnosis.verification.idle_limits import idle_limits
from diagnosis.verification.not_simulated import not_simulated
from diagnosis.verification.replaced_values import friction_replaced, smoothing_replaced
from diagnosis.verified import verify
from identification import recorded_signals, without_rotors
from identification.selection import Split


def diagnose(
    arm: Arm,
    fit: Sequence[Recording],
    held_out: Sequence[Recording],
    progress: Progress = lambda sentence: None,
) -> Diagnosis:
    """Diagnoses recordings of an arm against its model. InputError where a recording does not belong to the arm.

    Another recording is held out if those that are given show nothing of a joint, and that explains it. In the
    recordings from which the arm was identified, all that its model lacks is a cause.
    """
    known = known_in(arm, [*fit, *held_out])
    found = _with_held_out(known, fit, held_out, progress)
    if (roles := other_roles(found, fit, held_out)) is not None:
        progress("holding out another recording")
        found = better(found, _with_held_out(known, roles.fit, roles.held_out, progress))
    return found if known is arm else _for_other_days(found, arm, fit, held_out)


def _for_other_days(found: Diagnosis, arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording]) -> Diagnosis:
    """Of the recordings of its identification, with the uncertainty of the arm as ``identify`` states it.

    That of the extended model has what this leaves in them.
    """
    known = arm.uncertainty
    if known is not None and found.causes:
        known = left_over(replace(found.extended, uncertainty=known), held_out, fit).added_to(known)
    return replace(found, arm=arm, extended=replace(found.extended, uncertainty=known))


def _with_held_out(arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording], progress: Progress) -> Diagnosis:
    """``diagnose`` with these recordings held out."""
    model, arm = arm, with_reference(arm, fit)
    recordings: Recordings = Split(fit, held_out, bool({r.path for r in fit} & {r.path for r in held_out}))
    cleaned = screen(arm, recordings, progress)
    # angles that single counters lost are put back
    recordings = Split(cleaned.recordings[: len(fit)], cleaned.recordings[len(fit) :], recordings.two_fold)
    instruments = measure(arm, recordings, cleaned, progress)
    as_tracked = recordings, [q for _, q, _ in cleaned.samples]
    recordings, cleaned = on_uniform_grid(recordings, cleaned)
    instruments = isolated_by_currents(arm, instruments, cleaned, progress)
    instruments = links_damped(arm, instruments, cleaned, len(fit), progress)
    currents = find_causes(arm, instruments.in_model, recordings, cleaned, progress)
    aligned = with_aligned_currents([*recordings.fit, *recordings.held_out], currents.residuals)
    recordings = Split(aligned[: len(fit)], aligned[len(fit) :], recordings.two_fold)
    instruments = tracked_beside(
        [*currents.causes, *currents.outside_selection], arm, instruments, *as_tracked, progress
    )
    instruments = tracked_damped(instruments, currents, recordings.fit, progress)
    causes, as_found = extended_model(arm, instruments, currents, recordings)
    extended = dissipative(as_found, top_speeds(currents))
    verified = verify(arm, extended, causes, recordings, currents, judged=instruments.judged)
    extended = verified.extended
    unexplained = unexplained_structure(cleaned, instruments, currents, verified, recordings)
    state = currents.state
    return Diagnosis(
        arm=model,
        extended=with_needed_reference(extended, model),
        fit=tuple(with_own(run, ()) for run in state.data.fit.runs),
        held_out=tuple(with_own(run, ()) for run in state.data.held_out.runs),
        residual=state.residual,
        causes=_with_confidence(verified.causes, instruments, currents, unexplained),
        undetectable=undetectable(instruments, currents),
        unexplained=unexplained,
        closed_loops=verified.closed_loops,
        along_motion=verified.along_motion,
        encoder_noise=angle_noise(without_blanks(fit[0]).q),
        link=instruments.link,
        tracked=instruments.tracked,
        axis=currents.axis,
        judged=instruments.judged,
        shortage=currents.shortage if instruments.judged else None,
        known_to=state.significance.allowed.held_out if state.model.uncertain else None,
        allowed_residuals=allowed_residuals(state, unexplained) if instruments.judged else [],
        warnings=(
            *cleaned.remarks,
            *_warnings(model, instruments, currents),
            *_replaced(as_found, extended),
            *remarks_on(currents.held, arm),
        ),
    )


def check_recordings(arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording] = ()) -> None:
    """InputError where ``diagnose`` does not take these recordings of the arm."""
    check(arm, [*fit, *held_out])
    _check_motions(arm, fit, held_out)


def screen(arm: Arm, recordings: Recordings, progress: Progress) -> Screened:
    """Recordings that belong to the arm and show a motion, their events found and removed."""
    cleaned = screened(arm, [*recordings.fit, *recordings.held_out], progress)
    _check_motions(arm, *recordings)
    return cleaned


def _check_motions(arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording]) -> None:
    check_motion(arm, fit, "fitted")
    if held_out:
        check_motion(arm, held_out, "held-out")


def on_uniform_grid(recordings: Recordings, cleaned: Screened) -> tuple[Recordings, Screened]:
    """Both with equally spaced rows, as the filters and difference quotients below require."""
    fit, held_out = even(recordings.fit), even(recordings.held_out)
    samples = [even_samples(recorded) for recorded in cleaned.samples]
    known_noises = [known_noise(t, q, known) for (t, q, _), known in zip(cleaned.samples, cleaned.known_noise)]
    on_grids = replace(cleaned, recordings=(*fit, *held_out), samples=samples, known_noise=known_noises)
    return Split(fit, held_out, recordings.two_fold), on_grids


def extended_model(
    arm: Arm, instruments: OtherInstruments, currents: CurrentDiagnosis, recordings: Recordings
) -> tuple[list[Cause], Arm]:
    """All causes, each named once, and the model extended by them; without current limits that no current reaches."""
    events = [*currents.residuals.events, *instruments.events]
    causes, extended = _extended_with(events, arm, instruments, currents, recordings)
    idle = idle_limits(causes, extended, recordings, currents.state.data)
    if not idle:
        return causes, extended
    remaining = [event for event in events if (event.effect, event.joint) not in idle]
    return _extended_with(remaining, arm, instruments, currents, recordings)


def _extended_with(
    raw: Sequence[Event], arm: Arm, instruments: OtherInstruments, currents: CurrentDiagnosis, recordings: Recordings
) -> tuple[list[Cause], Arm]:
    """``extended_model`` with these events of raw rows and setpoints."""
    known = [*instruments.in_model, *currents.outside_selection]
    events = [from_event(event, currents.arm, currents.state.data) for event in raw]
    causes = [*events, *currents.causes, *currents.per_recording]
    # a spring that link encoders show as well is in the model with their parameters
    of_model = {cause.key for cause in known}
    unknown = [cause for cause in instruments.tracked.causes if cause.key not in of_model]
    together = merge(causes if instruments.judged else [*causes, *instruments.of_links], unknown)
    extended = extend(currents.base, together) if together else currents.arm
    if extended is not arm and not currents.per_recording:
        extended = with_smoothing_velocities(extended, recordings.fit)
    every = [*currents.outside_selection, *causes, *instruments.of_links]
    return merge(every, instruments.tracked.causes, of_model), extended


def top_speeds(currents: CurrentDiagnosis) -> Array:
    """(n,) rad/s (m/s): the highest speed of each joint in any of the recordings."""
    speeds = [np.abs(run.brisk_v).max(axis=0) for run in currents.state.all_runs]
    return np.asarray(np.max(speeds, axis=0))


def _with_confidence(
    causes: Sequence[Cause], instruments: OtherInstruments, currents: CurrentDiagnosis, unexplained: Sequence[Structure]
) -> list[Cause]:
    """The causes with their confidence, which depends on the remaining noise ratios at their joints."""
    held_out, residual = currents.state.data.held_out, currents.state.residual.held_out
    noise_ratios = ratios(held_out.runs, residual) if instruments.judged else []
    return with_confidence(causes, {one.joint: one.ratio for one in noise_ratios}, len(unexplained))


def _replaced(as_found: Arm, extended: Arm) -> Iterator[str]:
    """Sentences on where the ``extended`` model differs from the causes, and on whether it can be simulated."""
    yield from friction_replaced(as_found, extended)
    yield from smoothing_replaced(as_found, extended)
    yield from not_simulated(extended)


def _warnings(arm: Arm, instruments: OtherInstruments, currents: CurrentDiagnosis) -> Iterator[str]:
    """What a reader of the result should know about the recordings and the model."""
    state, of_currents = currents.state, unexplained_of_currents(instruments, currents)
    if instruments.judged:
        yield from mixed_up(state.all_runs)
        yield from folding_warnings(state.all_runs)
        yield from not_held_out(state.residual.fit, state.data.fit, of_currents, state.significance.allowed.fit)
        if of_currents and (sentence := without_rotors(arm)):
            yield sentence
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
    yield from smoothing_replaced(arm, currents.base)
    yield from remarks(currents.axis, arm.joints[0]) if currents.axis else ()
    yield from instruments.link.remarks if instruments.link else ()
