"""Recordings screened and turned into residuals: events in raw rows are found and removed, the rest becomes ``Run``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from arm_io import InputError
from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm, EffectTerm
from daq.recording import Recording
from diagnosis.residual.comparable_rows import comparable_rows, rms_where
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import KnownNoise, still_noise
from diagnosis.residual.other_effects import residual_with
from diagnosis.residual.run import Run
from diagnosis.residual.run_setup import known_setpoints, set_up, setup_of
from diagnosis.screening.current_limit import current_limits
from diagnosis.screening.encoder_jumps import jumps, without_jumps
from diagnosis.screening.event import Event, Gain, united
from diagnosis.screening.lost_rows.counter_gaps import CounterGap, counter_gaps, put_back, without_weight
from diagnosis.screening.lost_rows.counter_gaps import event_of as event_of_gaps
from diagnosis.screening.lost_rows.lost_triggers import (
    MOST_ROWS,
    DroppedTriggers,
    dropped_triggers,
    event_of,
    realigned_rows,
    unmeasured,
)
from diagnosis.screening.lost_rows.missing_rows import event_of as event_of_missing
from diagnosis.screening.lost_rows.missing_rows import gaps_of, missing_rows
from diagnosis.screening.lost_rows.skipped_rows import Hole, filled, holes_of, remark
from diagnosis.screening.lost_rows.skipped_rows import without_weight as without_skipped
from diagnosis.screening.mains_hum import lines_near_mains, mains_hum, other_lines, without_hum
from diagnosis.screening.standstill import Oscillation, oscillations
from diagnosis.units import recorded_quantity, recorded_signals, variable_in_words
from identification.preprocessing import check_joints

Samples = tuple[Array, Array, Array]

MATTERS = 0.7
"""Share of its error that a recording may keep when a long gap is put right: its currents were far from their rows."""
OWN_LIMIT = 0.02
"""Relative difference below which an observed limit is the model's own."""


@dataclass(frozen=True)
class Residuals:
    """Residuals of recordings under one model, and events.

    runs, samples  every recording without its events, as residual and as t (k,) s, q (k, n) rad, i (k, n) A
    periods        s between rows
    known          of the noise of the instruments of each recording
    holes          rows of each that its stamps leave out
    losses         dropped triggers that were corrected
    as_recorded    the same before; None: none were
    """

    events: list[Event]
    runs: list[Run]
    samples: list[Samples]
    periods: list[float]
    known: list[KnownNoise]
    holes: Sequence[Sequence[Hole]]
    losses: Sequence[DroppedTriggers] = ()
    as_recorded: Residuals | None = None


@dataclass(frozen=True, kw_only=True)
class Screened:
    """Recordings whose events were found and removed, whatever the effects of the model.

    events   in raw rows; samples: t (k,) s, q (k, n) rad, i (k, n) A of every recording without them
    known    of the noise of the instruments of each recording
    counter_gaps  of every recording: rows that its counters lost, interpolated in its angles
    holes    ... and rows that its stamps leave out, interpolated
    remarks  what the raw rows show besides
    oscillating  currents that oscillate while the arm stands
    """

    recordings: tuple[Recording, ...]
    events: list[Event]
    samples: list[Samples]
    known: list[KnownNoise]
    counter_gaps: tuple[tuple[CounterGap, ...], ...]
    holes: tuple[tuple[Hole, ...], ...]
    remarks: tuple[str, ...] = ()
    oscillating: tuple[Oscillation, ...] = ()


def screened(
    arm: Arm, recordings: Sequence[Recording], progress: Callable[[str], None] = lambda sentence: None
) -> Screened:
    """Removes the events of recordings. InputError where one does not belong to the arm."""
    recordings = list(recordings)
    check(arm, recordings)
    progress("searching for events in raw rows")
    holes = tuple(holes_of(r.t) for r in recordings)
    recordings = [filled(r, own) for r, own in zip(recordings, holes)]
    powered = [r for r in recordings if not setup_of(r).drives_off]
    still, oscillating = still_noise(powered), oscillations(powered)
    for one in oscillating:
        still[one.joint - 1] = 0.0  # not known: what oscillates is no noise
    known = [KnownNoise(still=still, setpoints=known_setpoints(arm, r)) for r in recordings]
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
        samples=[(r.t, without_jumps(r, index, events), without_hum(r, events)) for index, r in enumerate(recordings)],
        known=known,
        counter_gaps=tuple((*own, *single) for own, single in zip(by_all, gaps)),
        holes=holes,
        remarks=(*(remark(r, own) for r, own in zip(recordings, holes) if own), *other_lines(lines, arm)),
        oscillating=tuple(oscillating),
    )


def _counter_gaps(
    arm: Arm, recordings: Sequence[Recording], known: Sequence[KnownNoise]
) -> tuple[tuple[tuple[CounterGap, ...], ...], list[Event]]:
    """Rows that single counters lost in each recording, and the event that they are."""

    def residual(k: int, q: Array) -> Run:
        r, setup = recordings[k], setup_of(recordings[k])
        return residual_run(r.path.name, set_up(arm, r), r.t, q, r.i, powered=not setup.drives_off, known=known[k])

    gaps = tuple(tuple(counter_gaps(r.q, r.dt, partial(residual, k))) for k, r in enumerate(recordings))
    return gaps, [event_of_gaps(gaps, recordings, residual)] if any(gaps) else []


def residuals_of(arm: Arm, screened: Screened, progress: Callable[[str], None] = lambda sentence: None) -> Residuals:
    """The residuals of recordings under an arm."""
    progress("computing residuals")
    arms, nothing = [set_up(arm, recording) for recording in screened.recordings], np.zeros(0)

    def residual(k: int) -> Run:
        name, powered = screened.recordings[k].path.name, not setup_of(screened.recordings[k]).drives_off
        run = residual_run(name, arms[k], *screened.samples[k], powered=powered, known=screened.known[k])
        # raw rows are here already
        return replace(run, raw=(nothing, nothing))

    found = in_parallel(residual, range(len(arms)))
    # the arm itself, of which recordings of one setup have the same
    runs = [replace(run, raw=(t, q), arm=own) for run, (t, q, _), own in zip(found, screened.samples, arms)]
    for k, gaps in enumerate(screened.counter_gaps):
        runs[k] = without_weight(runs[k], gaps, screened.recordings[k].dt) if gaps else runs[k]
    runs = [without_skipped(run, holes) for run, holes in zip(runs, screened.holes)]
    periods = [r.dt for r in screened.recordings]
    return realigned(Residuals(screened.events, runs, screened.samples, periods, screened.known, screened.holes), [])


def realigned(sight: Residuals, terms: Sequence[EffectTerm]) -> Residuals:
    """The recordings with dropped triggers corrected; the same object where there are none, or no others.

    terms: effects conditional on which the lags are estimated. Strong effects that are not in the model mask a change
    of lag, so that it is searched for again once they are known, in all recordings as they were recorded: what one
    shows is judged beside the others.
    """
    recorded = sight.as_recorded or sight
    runs = list(recorded.runs)
    if terms:
        runs = [replace(run, expected=run.current - residual_with(run, terms)) for run in runs]
    found = dropped_triggers(runs, recorded.periods)
    if _rows_of(found) <= _rows_of(sight.losses):
        return sight
    before, runs, samples, losses = recorded.runs, list(recorded.runs), list(recorded.samples), list(found)
    for k in sorted({loss.recording for loss in found}):
        here = [loss for loss in found if loss.recording == k]
        t, q, i = samples[k]
        for loss in here:
            i = realigned_rows(i, loss)
        again = residual_run(runs[k].name, runs[k].arm, t, q, i, powered=runs[k].powered, known=sight.known[k])
        again = unmeasured(without_skipped(again, sight.holes[k]), here)
        # of the same rows: those that were not measured have no say in either
        if _energy(again, terms) < _energy(unmeasured(before[k], here), terms):
            samples[k], runs[k] = (t, q, i), again
        else:  # another error, which follows a change of lag at some joints and contradicts it at others
            losses = [loss for loss in losses if loss.recording != k]
    if _rows_of(losses) <= _rows_of(sight.losses):
        return sight
    most = losses[0].recording
    gain = _gain_of_realignment(before[most], runs[most], terms)
    if any(abs(loss.count) > MOST_ROWS for loss in losses) and gain.after > MATTERS * gain.before:
        return sight
    event = replace(event_of(losses, runs), gain=gain)
    events = united([*recorded.events, event])
    return replace(recorded, events=events, runs=runs, samples=samples, losses=losses, as_recorded=recorded)


def _rows_of(losses: Sequence[DroppedTriggers]) -> Counter[tuple[int, int]]:
    """How many losses there are of each recording and count."""
    return Counter((loss.recording, loss.count) for loss in losses)


def confirmed(sight: Residuals, terms: Sequence[EffectTerm]) -> Residuals:
    """The recordings as recorded if, with the effects ``terms``, nothing in them shows dropped triggers any more.

    An effect that is not in the model may look like a change of lag until it is known.
    """
    before = sight.as_recorded
    return sight if before is None or realigned(before, terms) is not before else before


def _energy(run: Run, terms: Sequence[EffectTerm]) -> float:
    """Mean square of a run's whitened residual over all joints, with more effects, at the constant lag that fits best.

    A lag that changes looks like a time skew between both lags as long as it is not known: such a skew among the
    ``terms`` must not speak against rows that were put where they belong.
    """
    y, rate = residual_with(run, terms) / run.deviation, run.current_rate / run.deviation
    size = float(np.sum(rate**2))
    return float(np.sum(y**2) - np.sum(y * rate) ** 2 / size if size > 0.0 else np.sum(y**2)) / y.size


def _gain_of_realignment(original: Run, corrected: Run, terms: Sequence[EffectTerm]) -> Gain:
    """Gain by realigned currents at the joint where it is largest."""
    rows = comparable_rows(original) & comparable_rows(corrected)
    before, after = (rms_where(residual_with(run, terms), rows) for run in (original, corrected))
    most = int(np.argmax((before**2 - after**2) / corrected.noise**2))
    return Gain(before=float(before[most]), after=float(after[most]), unit="A", joint=most + 1)


def _its_own(arm: Arm, limit: Event) -> bool:
    """Whether a current is clipped at the torque limit of the model."""
    assert limit.joint is not None
    joint = arm.joints[limit.joint - 1]
    value, std = next((p.value, p.std) for p in limit.parameters if p.name == "limit")
    own = None if joint.torque_limit is None else joint.torque_limit / joint.drive_constant
    return own is not None and abs(value - own) < 2 * std + OWN_LIMIT * own


LEAST_RATE = 20.0
"""rows/s: below, reversals last no row, and nothing is left of the band in which currents are compared."""


def check(arm: Arm, recordings: Sequence[Recording]) -> None:
    """InputError where a recording does not belong to the arm, is too short, or has missing or constant signals."""
    for r in recordings:
        check_joints(r, arm)
        if r.dt > 1.0 / LEAST_RATE:
            raise InputError(
                r.path,
                f"has {1 / r.dt:.3g} rows per second; at least {LEAST_RATE:g} are needed to compare "
                f"{recorded_signals(arm)} (100 and more show all that the comparison can)",
            )
        if len(r) < 3 / r.dt:
            raise InputError(r.path, f"is {len(r) * r.dt:.1f} s long; at least 3 s are needed")
        for name, values in (("position", r.q), ("current", r.i)):
            missing = np.isnan(values).any(axis=0)
            if missing.any():
                j = int(np.argmax(missing))
                raise InputError(r.path, f"{variable_in_words(name, arm, j + 1)} of joint {j + 1} has missing samples")
        constant = np.ptp(r.i, axis=0) == 0.0
        if constant.any() and not setup_of(r).drives_off:
            j = int(np.argmax(constant))
            what = recorded_quantity(arm.joints[j])
            raise InputError(r.path, f"{what} of joint {j + 1} never changes; is it connected?")
