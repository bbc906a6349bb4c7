"""What a diagnosis leaves: structure that no cause explains, and effects that these recordings could not show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from arm_model import Arm
from daq.recording import Recording
from diagnosis.cause import Signal, Structure, Undetectable
from diagnosis.closed_loop.clear_errors import clear_errors
from diagnosis.closed_loop.comparison import LoopComparison, LoopPair, faithful
from diagnosis.closed_loop.model_errors import left_over_rms, spreads
from diagnosis.closed_loop.oscillation import with_oscillations
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.measurements.currents.detectability import (
    undetectable_by_currents,
    undetectable_without_dynamics,
    undetectable_without_warming,
)
from diagnosis.other_instruments import OtherInstruments
from diagnosis.remainder.fitted_only import in_fit_alone
from diagnosis.residual.other_effects import residual_with
from diagnosis.residual.run import Run
from diagnosis.residual.run_setup import has_demand
from diagnosis.screening.cleaned import Screened
from diagnosis.screening.lost_rows.lost_triggers import uncounted_change
from diagnosis.selection.design import Dataset
from diagnosis.verified import Verified
from identification.selection import Split


def unexplained_structure(
    cleaned: Screened,
    instruments: OtherInstruments,
    currents: CurrentDiagnosis,
    verified: Verified,
    recordings: Recordings,
) -> list[Structure]:
    """Everything above the noise that no cause explains, of any instrument and in closed loop."""
    of_currents, short = _in_either_set(instruments, currents), currents.shortage
    structures = [
        *(one for one in of_currents if one.fit_only or short is None or one.joint not in short.joints),
        *(changes_of_lag(currents) if instruments.judged else []),
        *(instruments.link.unexplained if instruments.link else []),
        *instruments.tracked.unexplained,
        *(
            oscillation.structure(currents.arm.joints[oscillation.joint - 1].command_unit)
            for oscillation in cleaned.oscillating
        ),
    ]
    reported = [one.joint for one in (*of_currents, *structures)]
    return [*structures, *_in_loop(verified, recordings, currents.state.data, reported)]


def _in_either_set(instruments: OtherInstruments, currents: CurrentDiagnosis) -> list[Structure]:
    """``unexplained_of_currents``, and what the fitted recordings alone leave at the other joints.

    The latter also at joints with friction near rest of undetermined size, in its place.
    """
    found = unexplained_of_currents(instruments, currents)
    if not instruments.judged:
        return found
    determined = [one for one in found if one not in currents.undetermined]
    fit_alone = in_fit_alone(currents.state, determined)
    joints = {one.joint for one in fit_alone}
    return [*(one for one in found if one in determined or one.joint not in joints), *fit_alone]


def unexplained_of_currents(instruments: OtherInstruments, currents: CurrentDiagnosis) -> list[Structure]:
    """Unexplained structure of the currents, also where the recordings are too short to judge it."""
    if currents.axis and currents.axis.wave:
        return [Structure(Signal.CURRENT, 1, "position", currents.axis.wave.share)]
    if not instruments.judged:
        return []
    structures = currents.selection.unexplained.structures
    joints = {structure.joint for structure in structures}
    return [*structures, *(structure for structure in currents.undetermined if structure.joint not in joints)]


def changes_of_lag(currents: CurrentDiagnosis) -> list[Structure]:
    """Recordings in which the lag of the currents changes with certainty, by rows that they do not determine.

    At a high rate, a loss of some rows changes a few seconds of one recording, and its residual by less than noise may.
    """
    structures = []
    for run in currents.state.all_runs:
        left = residual_with(run, currents.state.terms)
        if (change := uncounted_change(replace(run, expected=run.current - left))) is None:
            continue
        joint = int(np.argmax(np.mean((left / run.deviation) ** 2, axis=0))) + 1
        size = f"{1e3 * change.step:.1f} ({1e3 * change.std:.1f}) ms of lag of all currents, {run.name}"
        structures.append(Structure(Signal.CURRENT, joint, "time", 0.0, size))
    return structures


def _in_loop(
    verified: Verified, recordings: Recordings, data: Split[Dataset], reported: Sequence[int | None]
) -> list[Structure]:
    """What the closed loop leaves above the noise and the model's own uncertainty, if its controller is the arm's."""
    loops, extended, runs = verified.closed_loops, verified.extended, data.map(lambda part: part.runs)
    if not faithful(loops.held_out, verified.along_motion.held_out):
        return []
    fit, held_out = (partial(_sampled_loops, extended, *part) for part in zip(recordings, runs, loops))
    errors = clear_errors(loops, runs, reported, Split(fit, held_out), left_over_rms(extended))
    return with_oscillations(errors, (after for pairs in loops for _, after in pairs), extended)


def _sampled_loops(
    extended: Arm, recordings: Sequence[Recording], runs: Sequence[Run], loops: Sequence[LoopPair]
) -> list[list[LoopComparison]]:
    """The loops of arms drawn from the uncertainty of the extended model, of recordings that have setpoints."""
    looped = [(recording, run) for recording, run in zip(recordings, runs) if has_demand(recording)]
    return spreads(extended, [r for r, _ in looped], [run for _, run in looped], [after for _, after in loops])


def undetectable(instruments: OtherInstruments, currents: CurrentDiagnosis) -> list[Undetectable]:
    """Effects that these recordings could not show."""
    of_instruments = [
        *currents.causes,
        *currents.held,
        *currents.per_recording,
        *instruments.in_model,
        *currents.outside_selection,
    ]
    shown = {cause.key for cause in of_instruments} | instruments.tracked.shown
    of_currents = undetectable_by_currents(
        currents.library, currents.ripples, currents.state.data.held_out, shown, currents.arm
    )
    link = instruments.link.held_out.joints.tolist() if instruments.link else []
    unjudged = [] if instruments.judged else undetectable_without_dynamics(currents.arm, link)
    of_currents += undetectable_without_warming(currents.arm, currents.state.data, shown) if instruments.judged else []
    return of_currents + unjudged + instruments.tracked.undetectable
