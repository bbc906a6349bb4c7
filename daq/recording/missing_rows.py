"""What is missing in a file that was not finished or is damaged: every row handed to the recorder is found or accounted for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.ledger import LedgerSummary, Loss, LossReason
from daq.recording.mcap_file.writer import Progress


@dataclass(frozen=True)
class Found:
    """What could be read of a file.

    numbers   (n,) trigger numbers of its rows, increasing
    torn      (n,) bool: something unreadable stood between this row and the one before
    finished  the file has its end
    """

    numbers: NDArray[np.int64]
    torn: NDArray[np.bool_]
    finished: bool


def account(found: Found, ledger: LedgerSummary | None, progress: Progress | None) -> tuple[LedgerSummary, bool]:
    """The ledger of what was found, and whether it is sure that nothing more is missing.

    ledger    as it stands in the file; None where the recording ended before it was written, or where it is damaged
    progress  of the recorder when it ended; None where that is damaged
    """
    recorded = len(found.numbers)
    if ledger is not None and ledger.recorded == recorded:
        return ledger, True
    known = ledger.losses if ledger is not None else ()
    losses = [*known, *_missing(found, known, progress)]
    accounted = recorded + sum(loss.rows for loss in losses)
    triggers = max(accounted, ledger.triggers) if ledger is not None else accounted
    if triggers > accounted:
        last = int(found.numbers[-1]) if recorded else -1
        losses.append(Loss(last + 1, triggers - accounted, LossReason.DAMAGED, "where they stood cannot be told"))
    latched = ledger.latched if ledger is not None else progress.rows if progress is not None else accounted
    summary = LedgerSummary(triggers, latched, recorded, tuple(sorted(losses, key=lambda loss: loss.first)))
    return summary, ledger is not None or progress is not None


def _missing(found: Found, known: tuple[Loss, ...], progress: Progress | None) -> list[Loss]:
    """Numbers between the first and the last that are neither found nor known to be lost."""
    numbers = found.numbers
    if progress is not None and progress.rows:
        first, last = progress.first, progress.last
    elif len(numbers):
        first, last = int(numbers[0]), int(numbers[-1])
    else:
        return []
    before = np.concatenate([[first - 1], numbers])
    after = np.concatenate([numbers, [last + 1]])
    tail = LossReason.DAMAGED if found.finished else LossReason.UNFINISHED
    losses = []
    for place in np.flatnonzero(after - before > 1):
        if place == len(numbers):
            reason = tail
        else:
            reason = LossReason.DAMAGED if found.torn[place] else LossReason.UNKNOWN
        gap = (int(before[place]) + 1, int(after[place]))
        losses += [Loss(start, stop - start, reason) for start, stop in _without(gap, known)]
    return losses


def _without(gap: tuple[int, int], known: tuple[Loss, ...]) -> list[tuple[int, int]]:
    """The half-open interval ``gap`` without those of known losses (sorted by number)."""
    rest, (start, stop) = [], gap
    for loss in known:
        if loss.first + loss.rows <= start or loss.first >= stop:
            continue
        if loss.first > start:
            rest.append((start, loss.first))
        start = loss.first + loss.rows
    return rest + ([(start, stop)] if start < stop else [])
