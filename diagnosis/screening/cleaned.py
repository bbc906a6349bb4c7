"""Recordings screened: events in raw rows are found and removed, whatever the effects of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from arm_io.parallel import in_parallel
from arm_io.types import Array, Progress
from arm_model import Arm
from daq.recording import Recording
from diagnosis.residual.filters import Samples, rate_of
from diagnosis.residual.generation import current_inertia, residual_run
from diagnosis.residual.noise.channels import KnownNoise, SimulatedLoop, encoder_steps, still_noise
from diagnosis.residual.noise.instruments import Channels, without_noise
from diagnosis.residual.noise.simulated_loop import simulated_loop
from diagnosis.residual.run import Run
from diagnosis.residual.run_setup import known_setpoints, set_up, setup_of
from diagnosis.screening.current_limit import current_limits
from diagnosis.screening.encoder_jumps import jumps, without_jumps
from diagnosis.screening.event import Event, united
from diagnosis.screening.lost_rows.blank_samples import Blank, blanks_of, sentences, without_blanks
from diagnosis.screening.lost_rows.counter_gaps import CounterGap, counter_gaps, put_back
from diagnosis.screening.lost_rows.counter_gaps import event_of as event_of_gaps
from diagnosis.screening.lost_rows.losses import DroppedTriggers, realigned_rows
from diagnosis.screening.lost_rows.missing_rows import event_of as event_of_missing
from diagnosis.screening.lost_rows.missing_rows import gaps_of, missing_rows
from diagnosis.screening.lost_rows.skipped_rows import Hole, filled, holes_of, remark
from diagnosis.screening.mains_hum import lines_near_mains, mains_hum, other_lines, without_hum
from diagnosis.screening.plausibility import check, recorded_otherwise
from diagnosis.screening.standstill import Oscillation, oscillations

OWN_LIMIT = 0.02
"""Relative difference below which an observed limit is the model's own."""
FEW_ROWS = 3.0
"""Rows per setpoint below which what servos do at setpoints is sampled into the band of comparison not along the
acceleration alone: of the SCARA with two rows each, it is above noise of 0.5 %."""


@dataclass(frozen=True, kw_only=True)
class Screened:
    """Recordings whose events were found and removed, whatever the effects of the model.

    events   in raw rows; samples: t (k,) s, q (k, n) rad, i (k, n) A of every recording without them
    known_noise  of the noise of the instruments of each recording
    counter_gaps  of every recording: rows that its counters lost, interpolated in its angles
    holes    ... and rows that its stamps leave out, interpolated
    blanks   ... and samples that are none, interpolated
    remarks  what the raw rows show besides
    oscillating  currents that oscillate while the arm stands
    """

    recordings: tuple[Recording, ...]
    events: list[Event]
    samples: list[Samples]
    known_noise: list[KnownNoise]
    counter_gaps: tuple[tuple[CounterGap, ...], ...]
    holes: tuple[tuple[Hole, ...], ...]
    blanks: tuple[tuple[Blank, ...], ...]
    remarks: tuple[str, ...] = ()
    oscillating: tuple[Oscillation, ...] = ()


def screened(arm: Arm, recordings: Sequence[Recording], progress: Progress = lambda sentence: None) -> Screened:
    """Removes the events of recordings. InputError where one does not belong to the arm."""
    recordings = list(recordings)
    check(arm, recordings)
    progress("searching for events in raw rows")
    unmeasured = [sentence for r in recordings for sentence in sentences(r)]
    blanks = tuple(blanks_of(r) for r in recordings)
    recordings = [without_blanks(r) for r in recordings]
    holes = tuple(holes_of(r.t) for r in recordings)
    recordings = [filled(r, own) for r, own in zip(recordings, holes)]
    powered = [r for r in recordings if not setup_of(r).drives_off]
    still, oscillating = still_noise(powered), oscillations(powered)
    for oscillation in oscillating:
        still[oscillation.joint - 1] = 0.0  # unknown, because an oscillation is not noise
    known = [KnownNoise(still=still, setpoints=known_setpoints(arm, r), demands=r.qref) for r in recordings]
    missing = missing_rows(recordings)
    of_all = [event_of_missing(missing, recordings)] if any(missing) else []
    by_all = [gaps_of(instants, r.joints, r.dt) for r, instants in zip(recordings, missing)]
    recordings = [replace(r, q=put_back(r.q, own)) if own else r for r, own in zip(recordings, by_all)]
    gaps, of_counters = _counter_gaps(arm, recordings, known)
    recordings = [replace(r, q=put_back(r.q, own)) if own else r for r, own in zip(recordings, gaps)]
    lines = lines_near_mains(recordings, arm)
    events = [
        *mains_hum(recordings, lines, arm),
        *united([*of_all, *of_counters, *jumps(recordings, arm)]),
        *(event for event in current_limits(recordings, arm) if not _its_own(arm, event)),
    ]
    return Screened(
        recordings=tuple(recordings),
        events=events,
        samples=[
            (r.t, without_jumps(r, arm, index, events), without_hum(r, events)) for index, r in enumerate(recordings)
        ],
        known_noise=known,
        counter_gaps=tuple((*own, *single) for own, single in zip(by_all, gaps)),
        holes=holes,
        blanks=blanks,
        remarks=(
            *recorded_otherwise(arm, recordings),
            *unmeasured,
            *(remark(r, own) for r, own in zip(recordings, holes) if own),
            *other_lines(lines, arm),
        ),
        oscillating=tuple(oscillating),
    )


def with_rows_put_back(screened: Screened, losses: Sequence[DroppedTriggers], event: Event) -> Screened:
    """The same with the currents realigned after dropped triggers, and with that event."""
    samples = list(screened.samples)
    for loss in losses:
        t, q, i = samples[loss.recording]
        samples[loss.recording] = t, q, realigned_rows(i, loss)
    return replace(screened, samples=samples, events=united([*screened.events, event]))


def with_simulated_loops(screened: Screened, arm: Arm) -> Screened:
    """The same with a simulated closed loop of ``arm`` for every recording, where the method's own error needs it.

    That is where the noise of the instruments is less than sampled rows resolve, or where there are fewer than
    ``FEW_ROWS`` rows per setpoint; elsewhere the same object. As all recordings have the same instruments, the shortest
    one whose loop follows it decides, and only then are the others simulated.
    """
    recordings, samples = screened.recordings, screened.samples
    loops: dict[int, SimulatedLoop | None] = {}
    for k in sorted(range(len(recordings)), key=lambda k: len(samples[k][0])):
        loops[k] = loop = simulated_loop(arm, recordings[k], samples[k])
        if loop is not None and loop.current.any():
            break
    else:
        return screened
    (t, q, i), own = samples[k], screened.known_noise[k]
    steps, rate = encoder_steps(q) if own.steps is None else own.steps, rate_of(t)
    few = own.setpoints.within and rate * own.setpoints.period < FEW_ROWS
    channels = Channels(q, i, current_inertia(arm, q), rate, replace(own, steps=steps, loop=loop))
    if not (few or without_noise(channels)):
        return screened
    others = [k for k in range(len(recordings)) if k not in loops]
    loops |= zip(others, in_parallel(lambda k: simulated_loop(arm, recordings[k], samples[k]), others))
    return replace(screened, known_noise=[replace(own, loop=loops[k]) for k, own in enumerate(screened.known_noise)])


def _counter_gaps(
    arm: Arm, recordings: Sequence[Recording], known: Sequence[KnownNoise]
) -> tuple[tuple[tuple[CounterGap, ...], ...], list[Event]]:
    """Rows that single counters lost in each recording, and the event that they are."""

    def residual(k: int, q: Array) -> Run:
        r, setup = recordings[k], setup_of(recordings[k])
        return residual_run(r.path.name, set_up(arm, r), r.t, q, r.i, powered=not setup.drives_off, known=known[k])

    gaps = tuple(tuple(counter_gaps(r.q, r.dt, partial(residual, k))) for k, r in enumerate(recordings))
    return gaps, [event_of_gaps(gaps, recordings, residual)] if any(gaps) else []


def _its_own(arm: Arm, limit: Event) -> bool:
    """Whether a current is clipped at its own torque limit in the model."""
    assert limit.joint is not None
    joint = arm.joints[limit.joint - 1]
    value, std = next((p.value, p.std) for p in limit.parameters if p.name == "limit")
    stated = None if joint.torque_limit is None else joint.torque_limit / joint.drive_constant
    return stated is not None and abs(value - stated) < 2 * std + OWN_LIMIT * stated
