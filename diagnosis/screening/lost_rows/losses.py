"""Triggers that a device dropped: what is known of them, and the recording with its rows in their places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model.effects.sensing import DROPPED_TRIGGER
from diagnosis.cause import Estimate, LostRows
from diagnosis.residual.run import Run
from diagnosis.screening.event import Event
from diagnosis.screening.lost_rows.unmeasured_rows import SMEARED, without_weight
from identification import recorded_signals

DOUBT = 0.1
"""s before and after a loss that have no weight at most, while its row is not known."""


@dataclass(frozen=True)
class DroppedTriggers:
    """Triggers that one recording (by its index) dropped.

    row (std ``row_std``) of the angles: after it, currents (angles, for a negative ``count``) belong to rows ``count``
    (``count_std``) later; period s between rows.
    """

    recording: int
    row: float
    row_std: float
    count: int
    count_std: float
    period: float


def event_of(losses: Sequence[DroppedTriggers], runs: Sequence[Run]) -> Event:
    """All dropped triggers as one event, with the parameters of the recording whose row is most certain."""
    best = min(losses, key=lambda loss: loss.row_std)
    signals = recorded_signals(runs[best.recording].arm)
    places = [
        f"{runs[loss.recording].name} from row {loss.row:.0f} ({loss.row * loss.period:.2f} s) on: "
        f"the {signals if loss.count > 0 else 'positions'} belong to rows {abs(loss.count)} later"
        for loss in losses
    ]
    parameters = [
        Estimate("row", best.row, best.row_std, "1"),
        Estimate("count", float(best.count), best.count_std, "1"),
        Estimate("period", best.period, 1e-3 * best.period, "s"),
    ]
    sentence = f"the lag of the {signals} changes by a whole number of rows at one instant: in {'; '.join(places)}"
    return Event(
        effect=DROPPED_TRIGGER.name,
        joint=None,
        parameters=parameters,
        evidence=sentence,
        recordings=tuple(loss.recording for loss in losses),
        lost_rows=tuple(
            LostRows(
                file=runs[loss.recording].name,
                joint=None,
                row=round(loss.row),
                time=loss.row * loss.period,
                count=loss.count,
                row_std=loss.row_std,
            )
            for loss in losses
        ),
    )


def realigned_rows(current: Array, loss: DroppedTriggers) -> Array:
    """(k, n) currents with the rows after the loss moved to where they belong; the rows lost repeat the last one."""
    row, count = int(loss.row), loss.count
    rows = np.arange(len(current), dtype=float)
    source = np.where(rows >= row + max(count, 0), rows - count, np.minimum(rows, row))
    lower = np.clip(np.floor(source).astype(int), 0, len(current) - 1)
    return np.asarray(current[lower], float)


def unmeasured(run: Run, losses: Sequence[DroppedTriggers]) -> Run:
    """A realigned run in which the lost rows have no weight, nor those near a loss whose row is not known.

    Where both are less than filters smear, rows keep theirs.
    """
    spans, end = [], float(run.t[-1])
    for loss in losses:
        start, length = loss.row * loss.period, abs(loss.count) * loss.period
        doubt = min(2.0 * loss.row_std * loss.period, DOUBT)
        if length > SMEARED and loss.count < 0:
            spans.append((end - length, end))
        if length + doubt > SMEARED:
            spans.append((start - doubt, start + doubt + (length if loss.count > 0 else 0.0)))
    return without_weight(run, spans)
