"""The ledger of an acquisition: triggers seen = rows recorded + rows lost, each loss with a reason."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from enum import StrEnum


class LossReason(StrEnum):
    """Why a trigger has no row in the file; each with a sentence in ``SENTENCES``."""

    LOST_EDGE = "lost_edge"
    NOT_LATCHED = "not_latched"
    DEVICE_GONE = "device_gone"
    OVERRUN = "overrun"
    QUEUE_FULL = "queue_full"
    DISK = "disk"
    UNFINISHED = "unfinished"
    DAMAGED = "damaged"
    UNKNOWN = "unknown"


SENTENCES = {
    LossReason.LOST_EDGE: "an edge of the trigger line was missed by the counter",
    LossReason.NOT_LATCHED: "a device made no row for this trigger",
    LossReason.DEVICE_GONE: "a device was unplugged or stopped answering",
    LossReason.OVERRUN: "a device's own buffer overflowed before it was read",
    LossReason.QUEUE_FULL: "the recorder could not keep up and its queue was full",
    LossReason.DISK: "the disk refused the data",
    LossReason.UNFINISHED: "the recording was cut off before these rows reached the disk",
    LossReason.DAMAGED: "the file is damaged where these rows were",
    LossReason.UNKNOWN: "lost while recording; the ledger that gave the reason was not written",
}


@dataclass(frozen=True)
class Loss:
    """``rows`` consecutive triggers from number ``first`` on that have no row, and why."""

    first: int
    rows: int
    reason: LossReason
    detail: str = ""  # which device, which error


@dataclass(frozen=True)
class LedgerSummary:
    """The balance of a recording.

    ``triggers == latched + lost before latching`` and ``latched == recorded + lost after``.

    triggers  edges that the clock made, seen or inferred from numbers and intervals
    latched   complete rows that the sampler made
    recorded  rows in the file
    """

    triggers: int
    latched: int
    recorded: int
    losses: tuple[Loss, ...] = field(default=())

    @property
    def lost(self) -> int:
        """Triggers without a row in the file."""
        return sum(loss.rows for loss in self.losses)

    @property
    def balanced(self) -> bool:
        """True if every trigger is accounted for."""
        return self.triggers == self.recorded + self.lost


class Ledger:
    """The sampler's account of a run: every trigger is a complete row handed on, or a loss; from any thread.

    The two sums come from different places - triggers from the edges of the clock, rows from the sampler's output - so
    that ``imbalance`` is a check and not an identity. What is lost between here and the disk is the recorder's to add.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._triggers = self._latched = 0
        self._losses: list[Loss] = []

    def see(self, triggers: int) -> None:
        """The clock has made ``triggers`` edges so far, seen or inferred."""
        with self._lock:
            self._triggers = max(self._triggers, triggers)

    def latch(self, rows: int) -> None:
        """The sampler made ``rows`` more complete rows."""
        with self._lock:
            self._latched += rows

    def lose(self, first: int, rows: int, reason: LossReason, detail: str = "") -> None:
        """Triggers ``first`` to ``first + rows - 1`` have no row."""
        if rows <= 0:
            return
        with self._lock:
            if self._losses:
                last = self._losses[-1]
                if (last.first + last.rows, last.reason, last.detail) == (first, reason, detail):
                    self._losses[-1] = Loss(last.first, last.rows + rows, reason, detail)
                    return
            self._losses.append(Loss(first, rows, reason, detail))

    def summary(self) -> LedgerSummary:
        """The account as it stands; all rows that were latched count as recorded, until a recorder says otherwise."""
        with self._lock:
            return LedgerSummary(self._triggers, self._latched, self._latched, tuple(self._losses))

    def imbalance(self) -> str | None:
        """None where every trigger is accounted for, else a sentence."""
        account = self.summary()
        if account.balanced:
            return None
        return (
            f"{account.triggers} triggers, but {account.latched} rows and {account.lost} lost: "
            f"{account.triggers - account.latched - account.lost} are unaccounted for"
        )
