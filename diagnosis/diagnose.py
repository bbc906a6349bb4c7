"""From recordings and a model to causes: screen, measure, select, verify, extend.

screen   events in raw rows are found and removed (``screening``)
measure  what tracker, link encoders and setpoints show without the currents (``other_instruments``)
select   what the currents show conditional on it (``find_causes``): residuals, columns of every effect, stepwise
         selection, unexplained structure
verify   the extended model in closed loop and along the measured motion (``verified``)
extend   all causes together, the model that has them (``extended_model``), what remains unexplained (``unexplained``),
         and what a reader should know of it (``result_warnings``)

All of it is the ``result``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from arm_io.types import Progress
from arm_model import Arm
from arm_model.effects import dissipative
from daq.recording import Recording
from diagnosis.another_day import known_in
from diagnosis.cause import Cause, Structure
from diagnosis.confidence import with_confidence
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.damping_by_currents import links_damped, tracked_damped
from diagnosis.extended_model import extended_model, top_speeds
from diagnosis.find_causes import find_causes
from diagnosis.isolated_by_currents import isolated_by_currents
from diagnosis.other_held_out import better, other_roles
from diagnosis.other_instruments import OtherInstruments, measure, tracked_beside
from diagnosis.remainder.against_noise import ratios
from diagnosis.remainder.of_identification import allowed_residuals, left_over
from diagnosis.residual.noise.channels import angle_noise
from diagnosis.residual.other_effects import with_own
from diagnosis.residual.warmth import with_needed_reference, with_reference
from diagnosis.result import Diagnosis
from diagnosis.result_warnings import replaced, warnings_of
from diagnosis.screening.cleaned import Screened, screened
from diagnosis.screening.even_rows import even, even_samples, known_noise
from diagnosis.screening.lost_rows.blank_samples import without_blanks
from diagnosis.screening.plausibility import check, check_motion
from diagnosis.screening.residuals import with_aligned_currents
from diagnosis.unexplained import undetectable, unexplained_structure
from diagnosis.verification.held_currents import remarks_on
from diagnosis.verified import verify
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
    recordings, cleaned, instruments, currents = _searched(arm, recordings, progress)
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
        known_to_fitted=state.significance.allowed.fit if state.model.uncertain else None,
        allowed_residuals=allowed_residuals(state, unexplained) if instruments.judged else [],
        warnings=(
            *cleaned.remarks,
            *warnings_of(model, instruments, currents),
            *replaced(as_found, extended),
            *remarks_on(currents.held, arm),
        ),
    )


def _searched(
    arm: Arm, recordings: Recordings, progress: Progress
) -> tuple[Recordings, Screened, OtherInstruments, CurrentDiagnosis]:
    """What every instrument shows of an arm, each beside the causes that the others have shown.

    The recordings as screened: rows equally spaced, jumps and lost rows put back.
    """
    cleaned = screen(arm, recordings, progress)
    # angles that single counters lost are put back
    recordings = recordings.cut(cleaned.recordings)
    instruments = measure(arm, recordings, cleaned, progress)
    recorded, recorded_angles = recordings, [q for _, q, _ in cleaned.samples]
    recordings, cleaned = on_uniform_grid(recordings, cleaned)
    instruments = isolated_by_currents(arm, instruments, cleaned, progress)
    instruments = links_damped(arm, instruments, recordings, cleaned, progress)
    currents = find_causes(arm, instruments.in_model, recordings, cleaned, progress)
    recordings = recordings.cut(with_aligned_currents([*recordings.fit, *recordings.held_out], currents.residuals))
    of_currents = [*currents.causes, *currents.outside_selection]
    instruments = tracked_beside(of_currents, arm, instruments, recorded, recorded_angles, progress)
    instruments = tracked_damped(instruments, currents, recordings.fit, progress)
    return recordings, cleaned, instruments, currents


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
    on_grids = recordings.map(even)
    samples = [even_samples(recorded) for recorded in cleaned.samples]
    known_noises = [known_noise(t, q, known) for (t, q, _), known in zip(cleaned.samples, cleaned.known_noise)]
    every = (*on_grids.fit, *on_grids.held_out)
    return on_grids, replace(cleaned, recordings=every, samples=samples, known_noise=known_noises)


def _with_confidence(
    causes: Sequence[Cause], instruments: OtherInstruments, currents: CurrentDiagnosis, unexplained: Sequence[Structure]
) -> list[Cause]:
    """The causes with their confidence, which depends on the remaining noise ratios at their joints."""
    held_out, residual = currents.state.data.held_out, currents.state.residual.held_out
    noise_ratios = ratios(held_out.runs, residual) if instruments.judged else []
    return with_confidence(causes, {one.joint: one.ratio for one in noise_ratios}, len(unexplained))
