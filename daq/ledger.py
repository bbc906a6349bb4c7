"""The ledger of an acquisition: triggers seen = rows recorded + rows lost, each loss with a reason."""

from __future__ import annotations

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
    LossReason.LOST_EDGE: "an edge of the trigger line was not seen by the counter",
    LossReason.NOT_LATCHED: "a device made no row for this trigger",
    LossReason.DEVICE_GONE: "a device was unplugged or stopped answering",
    LossReason.OVERRUN: "a device's own buffer ran over before it was read",
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
    """The balance of a recording; ``triggers == latched + lost before latching`` and ``latched == recorded + lost after``.

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
