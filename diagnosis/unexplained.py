"""What a diagnosis leaves: structure that no cause explains, and effects that these recordings could not show."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.cause import Signal, Structure, Undetectable
from diagnosis.closed_loop.clear_errors import clear_errors
from diagnosis.closed_loop.comparison import Compared, faithful
from diagnosis.closed_loop.model_errors import left_over_rms, spreads
from diagnosis.closed_loop.oscillation import with_oscillations
from diagnosis.current_diagnosis import CurrentDiagnosis, Recordings
from diagnosis.measurements.currents.detectability import (
    undetectable_by_currents,
    undetectable_without_dynamics,
    undetectable_without_warming,
)
from diagnosis.other_instruments import OtherInstruments
from diagnosis.remainder.fitted_only import in_fit_alone, known_to
from diagnosis.residual.run_setup import has_demand
from diagnosis.screening.cleaned import Screened
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
    state, of_currents = currents.state, unexplained_of_currents(instruments, currents)
    structures = [
        *(one for one in of_currents if currents.shortage is None or one.joint not in currents.shortage.joints),
        *(in_fit_alone(state, of_currents, known_to(state).fit) if instruments.judged else []),
        *(instruments.link.unexplained if instruments.link else []),
        *instruments.tracked.unexplained,
        *(
            oscillation.structure(currents.arm.joints[oscillation.joint - 1].command_unit)
            for oscillation in cleaned.oscillating
        ),
    ]
    reported = [one.joint for one in (*of_currents, *structures)]
    return [*structures, *_in_loop(verified, recordings, state.data, reported)]


def unexplained_of_currents(instruments: OtherInstruments, currents: CurrentDiagnosis) -> list[Structure]:
    """Unexplained structure of the currents, also where the recordings are too short to judge it."""
    if currents.axis and currents.axis.wave:
        return [Structure(Signal.CURRENT, 1, "position", currents.axis.wave.share)]
    if not instruments.judged:
        return []
    structures = currents.selection.unexplained.structures
    joints = {structure.joint for structure in structures}
    return [*structures, *(structure for structure in currents.undetermined if structure.joint not in joints)]


def _in_loop(
    verified: Verified, recordings: Recordings, data: Split[Dataset], reported: Sequence[int | None]
) -> list[Structure]:
    """What the closed loop leaves above the noise and the model's own uncertainty, if its controller is the arm's."""
    if not faithful(verified.compared["held_out"], verified.along["held_out"]):
        return []
    extended, runs = verified.extended, {"fit": data.fit.runs, "held_out": data.held_out.runs}
    sides = {"fit": recordings.fit, "held_out": recordings.held_out}

    def spread(side: str) -> list[list[Compared]]:
        looped = [(r, run) for r, run in zip(sides[side], runs[side]) if has_demand(r)]
        return spreads(
            extended,
            [r for r, _ in looped],
            [run for _, run in looped],
            [after for _, after in verified.compared[side]],
        )

    errors = clear_errors(verified.compared, runs, reported, spread, left_over_rms(extended))
    return with_oscillations(
        errors, (after for several in verified.compared.values() for _, after in several), extended
    )


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
