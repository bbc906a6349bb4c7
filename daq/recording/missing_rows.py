"""What is missing in an unfinished or damaged file: every row handed to the recorder is found or accounted for."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.ledger import LedgerSummary, Loss, LossReason
from daq.recording.mcap_file.writer import Progress


@dataclass(frozen=True)
class FoundRows:
    """What could be read of a file.

    runs      (k, 3) trigger numbers without a hole between them: first, last, and whether something unreadable was
              before the first
    finished  the file has its end
    """

    runs: NDArray[np.int64]
    finished: bool

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int((self.runs[:, 1] - self.runs[:, 0] + 1).sum())


class TriggerRuns:
    """Trigger numbers as they are read, kept as runs: of a recording of any length a few."""

    def __init__(self) -> None:
        self._runs: list[NDArray[np.int64]] = []

    def append(self, numbers: NDArray[np.int64], *, torn: bool) -> None:
        """Those that follow, increasing; ``torn``: something unreadable stands before them."""
        if not len(numbers):
            return
        breaks = np.flatnonzero(np.diff(numbers) != 1)
        first, last = numbers[np.append(0, breaks + 1)], numbers[np.append(breaks, len(numbers) - 1)]
        runs = np.column_stack([first, last, np.zeros_like(first)])
        runs[0, 2] = torn
        if self._runs and self._runs[-1][-1, 1] + 1 == first[0]:
            self._runs[-1][-1, 1] = last[0]
            runs = runs[1:]
        if len(runs):
            self._runs.append(runs)

    def runs(self) -> NDArray[np.int64]:
        """As ``FoundRows`` has them."""
        return np.concatenate([np.empty((0, 3), np.int64), *self._runs])


def reconciled(found: FoundRows, ledger: LedgerSummary | None, progress: Progress | None) -> tuple[LedgerSummary, bool]:
    """The ledger of what was found, and whether it is sure that nothing more is missing.

    ledger    as it stands in the file; None where the recording ended before it was written, or where it is damaged
    progress  of the recorder when it ended; None where that is damaged
    """
    recorded = found.rows
    if ledger is not None and ledger.recorded == recorded:
        return ledger, True
    known = ledger.losses if ledger is not None else ()
    losses = [*known, *_missing(found, known, progress)]
    explained = recorded + sum(loss.rows for loss in losses)
    triggers = max(explained, ledger.triggers) if ledger is not None else explained
    if triggers > explained:
        last = int(found.runs[-1, 1]) if recorded else -1
        losses.append(Loss(last + 1, triggers - explained, LossReason.DAMAGED, "their places are unknown"))
    latched = ledger.latched if ledger is not None else progress.rows if progress is not None else explained
    summary = LedgerSummary(triggers, latched, recorded, tuple(sorted(losses, key=lambda loss: loss.first)))
    return summary, ledger is not None or progress is not None


def _missing(found: FoundRows, known: tuple[Loss, ...], progress: Progress | None) -> list[Loss]:
    """Numbers between the first and the last that are neither found nor known to be lost."""
    runs = found.runs
    if progress is not None and progress.rows:
        first, last = progress.first, progress.last
    elif len(runs):
        first, last = int(runs[0, 0]), int(runs[-1, 1])
    else:
        return []
    before = np.concatenate([[first - 1], runs[:, 1]])
    after = np.concatenate([runs[:, 0], [last + 1]])
    ends = [loss.first + loss.rows for loss in known]
    tail = LossReason.DAMAGED if found.finished else LossReason.UNFINISHED
    losses = []
    for place in np.flatnonzero(after - before > 1):
        if place == len(runs):
            reason = tail
        else:
            reason = LossReason.DAMAGED if runs[place, 2] else LossReason.UNKNOWN
        gap = (int(before[place]) + 1, int(after[place]))
        losses += [
            Loss(start, stop - start, reason) for start, stop in _without(gap, known, bisect_right(ends, gap[0]))
        ]
    return losses


def _without(gap: tuple[int, int], known: tuple[Loss, ...], nearest: int) -> list[tuple[int, int]]:
    """The half-open interval ``gap`` less the known losses.

    ``known`` is sorted by trigger number; the losses before index ``nearest`` end before the gap.
    """
    rest, (start, stop) = [], gap
    for loss in known[nearest:]:
        if loss.first >= stop:
            break
        if loss.first > start:
            rest.append((start, loss.first))
        start = loss.first + loss.rows
    return rest + ([(start, stop)] if start < stop else [])
