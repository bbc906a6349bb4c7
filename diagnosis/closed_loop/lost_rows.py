"""Rows of currents that were lost at an instant, where closed loops show it and the measured motion does not.

A few rows at a high rate are below the noise along the measured motion (``current_lag``). A lag that is there
throughout is not named here: healthy arms have up to 1.1 servo periods of it, by when their servos read encoders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from diagnosis.closed_loop.current_lag import PIECE, Change, LagCosts, lag_costs
from diagnosis.screening.event import Gain
from diagnosis.screening.lost_rows.losses import DroppedTriggers
from identification.selection import Thresholds, p_value


@dataclass(frozen=True, kw_only=True)
class LostRowsLimits(Thresholds):
    """What a change of the lag of the currents in closed loop must satisfy to be rows that were lost.

    gain    least fall of the cost of a recording by it, below which it has none ...
    others  ... and at the joints other than the one where it falls most: all currents are lost alike
    whole   rows by which it may miss the whole number, and largest std of it
    """

    gain: float = 8.0
    others: float = 3.0
    whole: float = 0.3


LIMITS = LostRowsLimits()


@dataclass(frozen=True)
class LostInLoop:
    """Rows that recordings lost, and how much of the closed-loop error of the first recording that explains."""

    losses: list[DroppedTriggers]
    gain: Gain


def lost_in_loop(
    arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording], currents: Sequence[Array]
) -> LostInLoop | None:
    """Rows of currents that recordings lost; None where no fitted recording shows any.

    currents: (m, n) A of fitted, then held-out recordings, with rows put back that are known to be lost.
    """
    recordings, of_fit = [*fit, *held_out], len(fit)
    losses = _lost(arm, recordings[:of_fit], currents[:of_fit], 0)
    if not losses:
        return None
    losses += _lost(arm, recordings[of_fit:], currents[of_fit:], of_fit)
    return LostInLoop([loss for loss, _, _ in losses], _gain(losses))


def _lost(
    arm: Arm, recordings: Sequence[Recording], currents: Sequence[Array], first: int
) -> list[tuple[DroppedTriggers, LagCosts, Change]]:
    """The losses of each recording with their evidence; ``first``: number of the first recording."""
    losses = []
    for number, (recording, current) in enumerate(zip(recordings, currents), first):
        if (costs := lag_costs(arm, recording, current)) is None:
            continue
        change = costs.change()
        if (loss := _of_change(number, change, recording.dt)) is not None:
            losses.append((loss, costs, change))
    return losses


def _of_change(recording: int, change: Change, period: float) -> DroppedTriggers | None:
    """Rows of the currents that a recording lost at one instant, if its lag changes by a whole number of rows."""
    total = float(change.gain.sum())
    if total < LIMITS.gain or total - float(change.gain.max()) < LIMITS.others:
        return None
    rows, std = (change.before - change.after) / period, change.std / period
    if not np.isfinite(std) or (count := round(rows)) < 1 or max(abs(rows - count), std) > LIMITS.whole:
        return None
    row, row_std = round(change.time / period), change.time_std / period
    return DroppedTriggers(recording, row, row_std, count, max(std, abs(rows - count), 0.05), period)


def _gain(losses: Sequence[tuple[DroppedTriggers, LagCosts, Change]]) -> Gain:
    """The closed-loop error of the first recording that the change of lag explains, at the joint with the most.

    With the probability that all recordings gain as much by chance: above 10 Hz, errors of one piece show nothing of
    the next.
    """
    _, costs, change = losses[0]
    j = int(np.argmax(change.gain))
    before, after = (float(np.sqrt(np.mean(one[:, j]) / PIECE)) for one in costs.energies(change))
    gains = [np.subtract(*costs_of_one.costs(its)).sum(axis=1) for _, costs_of_one, its in losses]
    return Gain(before=before, after=after, unit="A", joint=int(costs.joints[j]), p=p_value(np.concatenate(gains)))
