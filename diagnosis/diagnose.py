"""From recordings and a model to causes: screen, measure, select, verify, extend.

screen   events in raw rows are found and removed (``screening``)
measure  what tracker, link encoders and setpoints show without the currents (``measurements``)
select   what the currents show conditional on it (``find_causes``): residuals, columns of every effect, stepwise
         selection, unexplained structure
verify   the extended model in closed loop and along the measured motion (``closed_loop``)
extend   all causes together, the extended model, and what these recordings could not show
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm
from arm_model.effects import Instrument, dissipative
from daq.recording import Recording
from diagnosis.cause import Cause, Signal, Structure, Undetectable, extend, merge
from diagnosis.closed_loop.clear_errors import clear_errors
from diagnosis.closed_loop.comparison import (
    Compared,
    along_motion,
    before_and_after,
    compare,
    faithful,
    has_demand,
    with_smoothing_velocities,
)
from diagnosis.closed_loop.model_errors import healthy, spreads
from diagnosis.closed_loop.oscillation import with_oscillations
from diagnosis.confidence import stated
from diagnosis.find_causes import Named, Recordings, named_causes
from diagnosis.measurements.currents.causes import from_event
from diagnosis.measurements.currents.detectability import not_judged, not_visible, not_warm
from diagnosis.measurements.currents.shortage import Shortage
from diagnosis.measurements.demands.wrist_coupling import wrist_coupling
from diagnosis.measurements.link_encoders.causes import LinkSide, link_side
from diagnosis.measurements.single_axis.causes import AxisSide
from diagnosis.measurements.single_axis.remarks import remarks
from diagnosis.measurements.tracker.causes import Tracked, tracked_causes
from diagnosis.origins import Suspect, evidence_of, suspects
from diagnosis.remainder.against_noise import ratios
from diagnosis.remainder.fitted_only import in_fit_alone, known_to, not_held_out
from diagnosis.remainder.of_identification import Remainder, remainders
from diagnosis.residual.expected_current import has_dynamics
from diagnosis.residual.folding_warnings import folding_warnings
from diagnosis.residual.noise.channels import angle_noise
from diagnosis.residual.other_effects import with_own
from diagnosis.residual.run import Run
from diagnosis.residual.warmth import reference_taken, with_needed_reference, with_reference
from diagnosis.screening.cleaned import Screened, screened
from diagnosis.screening.even_rows import even, even_samples, grid_of, known_noise
from diagnosis.screening.event import Event
from diagnosis.screening.plausibility import check, check_motion, mixed_up
from diagnosis.selection.design import Dataset
from diagnosis.units import recorded_signals
from diagnosis.verification.idle_limits import idle_limits
from diagnosis.verification.not_simulated import not_simulated
from diagnosis.verification.replaced_values import friction_replaced, smoothing_replaced
from identification.selection import Split


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """Everything that the report and diagnosis.json say.

    arm, extended  the model, and the model with every cause as an effect
    fit, held_out  residuals of the recordings; left: (N,) whitened, with all causes
    compared       of "fit" and "held_out", each recording's closed loop by the model and by the extended one
    along          ... and (n,) A rms of its residual under both along the measured motion
    judged         whether the currents were compared: not with a model that predicts none
    shortage       what the held-out recordings are too short for
    known_to       (n,) times the noise that held-out residuals may be by what the model says of its own uncertainty
    remainders     what is above the noise within that, joint by joint
    """

    arm: Arm
    extended: Arm
    fit: tuple[Run, ...]
    held_out: tuple[Run, ...]
    left: Split[Array]
    causes: list[Cause]
    not_visible: list[Undetectable]
    unexplained: list[Structure]
    compared: dict[str, list[tuple[Compared, Compared]]] = field(repr=False)
    along: dict[str, list[tuple[Array, Array]]]
    encoder_noise: Array
    link: LinkSide | None = None
    tracked: Tracked | None = None
    axis: AxisSide | None = None
    judged: bool = True
    shortage: Shortage | None = None
    known_to: Array | None = None
    remainders: list[Remainder] = field(default_factory=list)
    warnings: tuple[str, ...] = ()

    @property
    def in_closed_loop(self) -> bool:
        """Whether current errors are those of the closed loop on the same demands; else along the measured motion."""
        return faithful(self.compared["held_out"], self.along["held_out"])

    @property
    def verdict(self) -> str:
        """``consistent``, ``explained`` or ``unexplained``; with a ``shortage``, of what could be judged."""
        if self.unexplained:
            return "unexplained"
        return "explained" if self.causes else "consistent"

    @property
    def origins(self) -> list[Suspect]:
        """Physical origins of the causes, per joint and of the arm; none where unexplained structure remains."""
        places = evidence_of(
            self.causes, self.arm, self._searched, {(one.effect, one.joint) for one in self.not_visible}
        )
        unexplained = {one.joint for one in self.unexplained}
        return suspects([place for place in places if place.joint not in unexplained])

    @property
    def _searched(self) -> set[Instrument]:
        """Instruments whose effects would have been found."""
        found = {Instrument.RAW}
        if self.judged:
            found |= {Instrument.SINGLE_AXIS} if self.axis else {Instrument.CURRENT, Instrument.LAG}
        if self.link:
            found.add(Instrument.LINK_ENCODER)
        if self.tracked and self.tracked.rms:
            found.add(Instrument.TRACKER)
        return found


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What instruments other than the current transducers show.

    events  in setpoints
    judged  whether the model predicts any current with which the measured ones can be compared
    """

    tracked: Tracked
    link: LinkSide | None
    events: list[Event]
    judged: bool

    @property
    def known(self) -> list[Cause]:
        """Causes that are in the model before the currents are judged: of geometry and of transmissions."""
        return [*self.tracked.geometry, *(cause for cause in self.of_links if cause.of_arm and self.judged)]

    @property
    def of_links(self) -> list[Cause]:
        """Causes that the link encoders show."""
        return self.link.causes if self.link else []


@dataclass(frozen=True, kw_only=True)
class Verified:
    """The causes with their errors in closed loop, and both models compared with the recordings; see ``Diagnosis``."""

    extended: Arm
    causes: list[Cause]
    compared: dict[str, list[tuple[Compared, Compared]]]
    along: dict[str, list[tuple[Array, Array]]]


def diagnose(
    arm: Arm,
    fit: Sequence[Recording],
    held_out: Sequence[Recording],
    progress: Progress = lambda sentence: None,
) -> Diagnosis:
    """Diagnoses recordings of an arm against its model. InputError where a recording does not belong to the arm."""
    given, arm = arm, with_reference(arm, fit)
    recordings: Recordings = Split(fit, held_out, bool({r.path for r in fit} & {r.path for r in held_out}))
    cleaned = screen(arm, recordings, progress)
    # with the angles that single counters lost
    recordings = Split(cleaned.recordings[: len(fit)], cleaned.recordings[len(fit) :], recordings.two_fold)
    measured = measure(arm, recordings, cleaned, progress)
    recordings, cleaned = evenly(recordings, cleaned)
    named = named_causes(arm, measured.known, recordings, cleaned, progress)
    causes, as_found = extend_by(arm, measured, named, recordings)
    extended = dissipative(as_found, top_speeds(named))
    verified = verify(arm, extended, causes, recordings, named, judged=measured.judged)
    unexplained = _unexplained(cleaned, measured, named, verified, recordings)
    state = named.found.state
    left = {one.joint: one.ratio for one in ratios(state.data.held_out.runs, state.fitted.held_out)}
    return Diagnosis(
        arm=given,
        extended=with_needed_reference(extended, given),
        fit=tuple(with_own(run, ()) for run in state.data.fit.runs),
        held_out=tuple(with_own(run, ()) for run in state.data.held_out.runs),
        left=Split(state.fitted.fit, state.fitted.held_out),
        causes=stated(verified.causes, left if measured.judged else {}, len(unexplained)),
        not_visible=_undetectable(measured, named),
        unexplained=unexplained,
        compared=verified.compared,
        along=verified.along,
        encoder_noise=angle_noise(fit[0].q),
        link=measured.link,
        tracked=measured.tracked,
        axis=named.axis,
        judged=measured.judged,
        shortage=named.shortage if measured.judged else None,
        known_to=known_to(state).held_out if state.model.uncertain else None,
        remainders=remainders(state, unexplained) if measured.judged else [],
        warnings=(
            *cleaned.remarks,
            *_warnings(given, measured, named),
            *friction_replaced(as_found, extended),
            *not_simulated(extended),
        ),
    )


def check_recordings(arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording] = ()) -> None:
    """InputError where ``diagnose`` does not take these recordings of the arm."""
    check(arm, [*fit, *held_out])
    check_motion(arm, fit, "fitted")
    if held_out:
        check_motion(arm, held_out, "held-out")


def screen(arm: Arm, recordings: Recordings, progress: Progress) -> Screened:
    """Recordings that belong to the arm and show a motion, their events found and removed."""
    cleaned = screened(arm, [*recordings.fit, *recordings.held_out], progress)
    check_motion(arm, recordings.fit, "fitted")
    check_motion(arm, recordings.held_out, "held-out")
    return cleaned


def evenly(recordings: Recordings, cleaned: Screened) -> tuple[Recordings, Screened]:
    """Both with equally spaced rows, as filters and differences take them."""
    fit, held_out = even(recordings.fit), even(recordings.held_out)
    samples = [even_samples(one) for one in cleaned.samples]
    known = [known_noise(q, grid_of(t), one) for (t, q, _), one in zip(cleaned.samples, cleaned.known)]
    on_grids = replace(cleaned, recordings=(*fit, *held_out), samples=samples, known=known)
    return Split(fit, held_out, recordings.two_fold), on_grids


def measure(arm: Arm, recordings: Recordings, cleaned: Screened, progress: Progress) -> Measured:
    """What tracker, link encoders and setpoints show."""
    angles = [q for _, q, _ in cleaned.samples]
    tracked = tracked_causes(arm, *recordings, angles=angles, progress=progress)
    progress("comparing motor and link encoders")
    return Measured(
        tracked=tracked,
        link=link_side(arm, *recordings),
        events=wrist_coupling(*recordings),
        judged=has_dynamics(arm),
    )


def extend_by(arm: Arm, measured: Measured, named: Named, recordings: Recordings) -> tuple[list[Cause], Arm]:
    """All causes, each named once, and the model extended by them; without limits at which no current ever is."""
    events = [*named.sight.events, *measured.events]
    causes, extended = _with_events(events, arm, measured, named, recordings)
    idle = idle_limits(causes, extended, recordings, named.found.state.data)
    if not idle:
        return causes, extended
    kept = [event for event in events if (event.effect, event.joint) not in idle]
    return _with_events(kept, arm, measured, named, recordings)


def _with_events(
    raw: Sequence[Event], arm: Arm, measured: Measured, named: Named, recordings: Recordings
) -> tuple[list[Cause], Arm]:
    """``extend_by`` with these events of raw rows and setpoints."""
    known = [*measured.known, *named.beside]
    events = [from_event(event, named.arm, named.found.state.data) for event in raw]
    causes = [*events, *named.causes, *named.own]
    unknown = [cause for cause in measured.tracked.causes if cause not in known]
    together = merge(causes if measured.judged else [*causes, *measured.of_links], unknown)
    extended = extend(named.base, together) if together else named.arm
    if extended is not arm and not named.own:
        extended = with_smoothing_velocities(extended, recordings.fit)
    return merge([*named.beside, *causes, *measured.of_links], measured.tracked.causes), extended


def top_speeds(named: Named) -> Array:
    """(n,) rad/s (m/s): the highest speed of each joint in any of the recordings."""
    speeds = [np.abs(run.brisk_v).max(axis=0) for part in named.found.state.data for run in part.runs]
    return np.asarray(np.max(speeds, axis=0))


def verify(
    arm: Arm, extended: Arm, causes: Sequence[Cause], recordings: Recordings, named: Named, *, judged: bool
) -> Verified:
    """The model and the extended one in closed loop on the recorded setpoints, and along the measured motion."""
    runs = named.found.state.data.map(lambda part: part.runs)
    halves = {"fit": (recordings.fit, runs.fit), "held_out": (recordings.held_out, runs.held_out)}
    pairs = before_and_after([*recordings.fit, *recordings.held_out], [*runs.fit, *runs.held_out], arm, extended)
    first = len(runs.fit)
    compared = {
        half: [pair for pair in several if pair is not None]
        for half, several in (("fit", pairs[:first]), ("held_out", pairs[first:]))
    }
    simulated = [after for _, after in compared["held_out"]]
    return Verified(
        extended=extended,
        causes=[_shown_in_loop(cause, extended, simulated, *halves["held_out"]) for cause in causes],
        compared=compared,
        along={
            half: [along_motion(run, arm, extended) for run in seen if judged] for half, (_, seen) in halves.items()
        },
    )


def _unexplained(
    cleaned: Screened, measured: Measured, named: Named, verified: Verified, recordings: Recordings
) -> list[Structure]:
    """Everything above the noise that no cause explains, of any instrument and in closed loop."""
    state, of_currents = named.found.state, _of_currents(measured, named)
    found = [
        *(one for one in of_currents if named.shortage is None or one.joint not in named.shortage.joints),
        *(in_fit_alone(state, of_currents, known_to(state).fit) if measured.judged else []),
        *(measured.link.unexplained if measured.link else []),
        *measured.tracked.unexplained,
        *(one.structure(named.arm.joints[one.joint - 1].command_unit) for one in cleaned.oscillating),
    ]
    reported = [one.joint for one in (*of_currents, *found)]
    return [*found, *_in_loop(verified, recordings, state.data, reported)]


def _of_currents(measured: Measured, named: Named) -> list[Structure]:
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


def _undetectable(measured: Measured, named: Named) -> list[Undetectable]:
    """Effects that these recordings could not show."""
    told = [*named.causes, *named.own, *measured.known, *named.beside]
    shown = {cause.key for cause in told} | measured.tracked.shown
    of_currents = not_visible(named.library, named.ripples, named.found.state.data.held_out, shown, named.arm)
    link = measured.link.held_out.joints.tolist() if measured.link else []
    unjudged = [] if measured.judged else not_judged(named.arm, link)
    of_currents += not_warm(named.arm, named.found.state.data, shown) if measured.judged else []
    return of_currents + unjudged + measured.tracked.not_visible


def _warnings(arm: Arm, measured: Measured, named: Named) -> Iterator[str]:
    state, of_currents = named.found.state, _of_currents(measured, named)
    if measured.judged:
        yield from mixed_up([*state.data.fit.runs, *state.data.held_out.runs])
        yield from folding_warnings([*state.data.fit.runs, *state.data.held_out.runs])
        yield from not_held_out(state.fitted.fit, state.data.fit, of_currents, known_to(state).fit)
    else:
        yield f"{arm.name} has neither masses nor friction: its {recorded_signals(arm)} were not judged"
    for known, what in ((arm.uncertainty, "parameters are"), (arm.kinematic_uncertainty, "geometry is")):
        if known is not None and not known.parameters:
            yield f"the model names {known.file}, which is not beside it: its {what} taken for exact"
    yield from reference_taken(arm, [cause.key for cause in named.causes], state.data.fit.runs)
    yield from smoothing_replaced(arm, named.base)
    yield from remarks(named.axis, arm.joints[0]) if named.axis else ()
    yield from measured.link.remarks if measured.link else ()


def _shown_in_loop(
    cause: Cause, extended: Arm, having: Sequence[Compared], recordings: Sequence[Recording], runs: Sequence[Run]
) -> Cause:
    """A cause that shows in closed loop only, with the errors of that loop.

    Such as a current limit: the measured motion obeys it, and along that motion nothing is missing.
    """
    joint = cause.felt_at
    if joint is None or cause.before != cause.after or len(having) != len(recordings):
        return cause
    others = tuple(term for term in extended.effects if term not in cause.terms)
    without = [compare(r, replace(extended, effects=others), run) for r, run in zip(recordings, runs)]
    before, after = (
        float(np.sqrt(np.mean([one.error_rms("current")[joint - 1] ** 2 for one in several if one])))
        for several in (without, having)
    )
    return replace(cause, before=before, after=after) if all(without) else cause
