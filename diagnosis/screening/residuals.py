"""Residuals of screened recordings, and triggers that were dropped: these show in residuals, not in raw rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.parallel import in_parallel
from arm_io.types import Progress
from arm_model import Arm, EffectTerm
from daq.recording import Recording
from diagnosis.residual.comparable_rows import comparable_rows, rms_where
from diagnosis.residual.filters import Samples, rate_of
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import KnownNoise
from diagnosis.residual.noise.instruments import smoothed
from diagnosis.residual.other_effects import residual_with
from diagnosis.residual.run import Run
from diagnosis.residual.run_setup import set_up, setup_of
from diagnosis.screening.cleaned import Screened
from diagnosis.screening.event import Event, Gain, united
from diagnosis.screening.lost_rows.blank_samples import Blank, unweighted
from diagnosis.screening.lost_rows.counter_gaps import without_lost
from diagnosis.screening.lost_rows.losses import DroppedTriggers, event_of, realigned_rows, unmeasured
from diagnosis.screening.lost_rows.lost_triggers import MOST_ROWS, dropped_triggers, energy
from diagnosis.screening.lost_rows.skipped_rows import Hole, without_skipped
from identification.preprocessing import Setpoints

MATTERS = 0.7
"""Share of its error that a recording may keep when a long gap is put right: its currents were far from their rows."""


@dataclass(frozen=True)
class Residuals:
    """Residuals of recordings under one model, and events.

    runs, samples  every recording without its events, as residual and as t (k,) s, q (k, n) rad, i (k, n) A
    periods        s between rows
    known_noise    of the noise of the instruments of each recording
    holes, blanks  rows of each that its stamps leave out, and samples that are none
    losses         dropped triggers that were corrected
    as_recorded    the same before; None: none were
    """

    events: list[Event]
    runs: list[Run]
    samples: list[Samples]
    periods: list[float]
    known_noise: list[KnownNoise]
    holes: Sequence[Sequence[Hole]]
    blanks: Sequence[Sequence[Blank]]
    losses: Sequence[DroppedTriggers] = ()
    as_recorded: Residuals | None = None


def residuals_of(arm: Arm, screened: Screened, progress: Progress = lambda sentence: None) -> Residuals:
    """The residuals of recordings under an arm."""
    progress("computing residuals")
    arms, nothing = [set_up(arm, recording) for recording in screened.recordings], np.zeros(0)

    known = list(screened.known_noise)

    def residual(k: int) -> Run:
        name, powered = screened.recordings[k].path.name, not setup_of(screened.recordings[k]).drives_off
        run = residual_run(name, arms[k], *screened.samples[k], powered=powered, known=known[k])
        # raw rows are here already
        return replace(run, raw=(nothing, nothing))

    computed = in_parallel(residual, range(len(arms)))
    if (setpoints := of_one_host([run.setpoints for run in computed])) is not None:
        silent = [k for k, run in enumerate(computed) if run.powered and run.setpoints.source == "model"]
        for k in silent:
            known[k] = replace(known[k], setpoints=setpoints)
        for k, run in zip(silent, in_parallel(residual, silent)):
            computed[k] = run
    # the arm itself, of which recordings of one setup have the same
    runs = [
        replace(run, raw=(t, smoothed(q, rate_of(t), run.angle_band)), arm=own_arm)
        for run, (t, q, _), own_arm in zip(computed, screened.samples, arms)
    ]
    for k, gaps in enumerate(screened.counter_gaps):
        runs[k] = without_lost(runs[k], gaps, screened.recordings[k].dt) if gaps else runs[k]
    holes, blanks = screened.holes, screened.blanks
    runs = [unweighted(without_skipped(run, left_out), blank) for run, left_out, blank in zip(runs, holes, blanks)]
    periods = [r.dt for r in screened.recordings]
    return realigned(Residuals(screened.events, runs, screened.samples, periods, known, holes, blanks), [])


def of_one_host(found: Sequence[Setpoints]) -> Setpoints | None:
    """The setpoints that the currents of some recordings show, which come as often in all others; None: none do.

    In others the model alone states any, or nothing does. One host sends them all. A recording whose joints hardly
    accelerate does not show them, but has the same share of an inertia folded. Of several periods the longest: currents
    may show a part of it.
    """
    shown = [one for one in found if one.source == "currents" and one.period]
    return max(shown, key=lambda one: one.period, default=None)


def realigned(residuals: Residuals, terms: Sequence[EffectTerm]) -> Residuals:
    """The recordings with dropped triggers corrected; the same object where there are none, or no others.

    terms: effects conditional on which the lags are estimated. Strong effects that are not in the model mask a change
    of lag, so that it is searched for again once they are known, in all recordings as they were recorded: what one
    shows is judged beside the others.
    """
    recorded = residuals.as_recorded or residuals
    runs = list(recorded.runs)
    if terms:
        runs = [replace(run, expected=run.current - residual_with(run, terms)) for run in runs]
    dropped = dropped_triggers(runs, recorded.periods)
    if _rows_of(dropped) <= _rows_of(residuals.losses):
        return residuals
    recorded_runs, runs, samples, losses = recorded.runs, list(recorded.runs), list(recorded.samples), list(dropped)
    for k in sorted({loss.recording for loss in dropped}):
        of_recording = [loss for loss in dropped if loss.recording == k]
        t, q, i = samples[k]
        for loss in of_recording:
            i = realigned_rows(i, loss)
        corrected = residual_run(
            runs[k].name, runs[k].arm, t, q, i, powered=runs[k].powered, known=residuals.known_noise[k]
        )
        corrected = unweighted(without_skipped(corrected, residuals.holes[k]), residuals.blanks[k])
        corrected = unmeasured(corrected, of_recording)
        # of the same rows: those that were not measured count in neither
        if _energy(corrected, terms) < _energy(unmeasured(recorded_runs[k], of_recording), terms):
            samples[k], runs[k] = (t, q, i), corrected
        else:  # another error, which follows a change of lag at some joints and contradicts it at others
            losses = [loss for loss in losses if loss.recording != k]
    if _rows_of(losses) <= _rows_of(residuals.losses):
        return residuals
    first = losses[0].recording
    gain = _gain_of_realignment(recorded_runs[first], runs[first], terms)
    if any(abs(loss.count) > MOST_ROWS for loss in losses) and gain.after > MATTERS * gain.before:
        return residuals
    event = replace(event_of(losses, runs), gain=gain)
    events = united([*recorded.events, event])
    return replace(recorded, events=events, runs=runs, samples=samples, losses=losses, as_recorded=recorded)


def with_aligned_currents(recordings: Sequence[Recording], residuals: Residuals) -> list[Recording]:
    """The recordings with the currents of those samples in which rows were put back after dropped triggers.

    Closed loops answer the demands, so that their currents are in place.
    """
    lost = {k for event in residuals.events if event.lost_rows for k in event.recordings}
    lost |= {loss.recording for loss in residuals.losses}
    return [
        replace(r, i=i) if k in lost and i.shape == r.i.shape else r
        for k, (r, (_, _, i)) in enumerate(zip(recordings, residuals.samples, strict=True))
    ]


def _rows_of(losses: Sequence[DroppedTriggers]) -> Counter[tuple[int, int]]:
    """How many losses there are of each recording and count."""
    return Counter((loss.recording, loss.count) for loss in losses)


def confirmed(residuals: Residuals, terms: Sequence[EffectTerm]) -> Residuals:
    """The recordings as recorded if, with the effects ``terms``, nothing in them shows dropped triggers any more.

    An effect that the model lacks may look like a change of lag as long as it is not known.
    """
    before = residuals.as_recorded
    return residuals if before is None or realigned(before, terms) is not before else before


def _energy(run: Run, terms: Sequence[EffectTerm]) -> float:
    """``lost_triggers.energy`` of a run with more effects."""
    return energy(replace(run, expected=run.current - residual_with(run, terms)))


def _gain_of_realignment(original: Run, corrected: Run, terms: Sequence[EffectTerm]) -> Gain:
    """Gain by realigned currents at the joint where it is largest."""
    rows = comparable_rows(original) & comparable_rows(corrected)
    before, after = (rms_where(residual_with(run, terms), rows) for run in (original, corrected))
    j = int(np.argmax((before**2 - after**2) / corrected.noise**2))
    return Gain(before=float(before[j]), after=float(after[j]), unit="A", joint=j + 1)
