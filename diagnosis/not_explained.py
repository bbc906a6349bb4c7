"""What a diagnosis leaves: structure that no cause explains, and effects that these recordings could not show."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.cause import Signal, Structure, Undetectable
from diagnosis.closed_loop.clear_errors import clear_errors
from diagnosis.closed_loop.comparison import Compared, faithful, has_demand
from diagnosis.closed_loop.model_errors import healthy, spreads
from diagnosis.closed_loop.oscillation import with_oscillations
from diagnosis.measurements.currents.detectability import not_judged, not_visible, not_warm
from diagnosis.named import Named, Recordings
from diagnosis.other_instruments import OtherInstruments
from diagnosis.remainder.fitted_only import in_fit_alone, known_to
from diagnosis.screening.cleaned import Screened
from diagnosis.selection.design import Dataset
from diagnosis.verified import Verified
from identification.selection import Split


def unexplained_structure(
    cleaned: Screened, measured: OtherInstruments, named: Named, verified: Verified, recordings: Recordings
) -> list[Structure]:
    """Everything above the noise that no cause explains, of any instrument and in closed loop."""
    state, of_currents = named.found.state, unexplained_of_currents(measured, named)
    found = [
        *(one for one in of_currents if named.shortage is None or one.joint not in named.shortage.joints),
        *(in_fit_alone(state, of_currents, known_to(state).fit) if measured.judged else []),
        *(measured.link.unexplained if measured.link else []),
        *measured.tracked.unexplained,
        *(one.structure(named.arm.joints[one.joint - 1].command_unit) for one in cleaned.oscillating),
    ]
    reported = [one.joint for one in (*of_currents, *found)]
    return [*found, *_in_loop(verified, recordings, state.data, reported)]


def unexplained_of_currents(measured: OtherInstruments, named: Named) -> list[Structure]:
    """Unexplained structure of the currents, also where the recordings are too short to judge it."""
    if named.axis and named.axis.wave:
        return [Structure(Signal.CURRENT, 1, "position", named.axis.wave.share)]
    if not measured.judged:
        return []
    found = named.found.unexplained.structures
    return [*found, *(one for one in named.undetermined if one.joint not in {other.joint for other in found})]


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
            extended, [r for r, _ in looped], [run for _, run in looped], [one for _, one in verified.compared[side]]
        )

    found = clear_errors(verified.compared, runs, reported, spread, healthy(extended))
    return with_oscillations(found, (after for several in verified.compared.values() for _, after in several), extended)


def undetectable(measured: OtherInstruments, named: Named) -> list[Undetectable]:
    """Effects that these recordings could not show."""
    told = [*named.causes, *named.own, *measured.known, *named.beside]
    shown = {cause.key for cause in told} | measured.tracked.shown
    of_currents = not_visible(named.library, named.ripples, named.found.state.data.held_out, shown, named.arm)
    link = measured.link.held_out.joints.tolist() if measured.link else []
    unjudged = [] if measured.judged else not_judged(named.arm, link)
    of_currents += not_warm(named.arm, named.found.state.data, shown) if measured.judged else []
    return of_currents + unjudged + measured.tracked.not_visible
