"""Rows from Zenoh, and an exact count of those that were missed."""

from __future__ import annotations

import queue
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from daq.row_block import RowBlock, decode
from daq.session import Keys

if TYPE_CHECKING:
    import zenoh


@dataclass
class Tally:
    """What was received of one run.

    run       its id; '' before the first block
    joined    rows published before the first block that was received: not missed, but not seen either
    received  rows; missed: rows that were published in between and never came; complete: the end of the run was seen
    """

    run: str = ""
    joined: int = 0
    received: int = 0
    missed: int = 0
    complete: bool = False

    def add(self, block: RowBlock) -> int:
        """Counts a block and returns how many rows are missing right before it. A new run starts a new count."""
        if block.run != self.run:
            self.run, self.joined, self.received, self.missed = block.run, block.before, 0, 0
        gap = block.before - (self.joined + self.received + self.missed)
        self.missed += gap
        self.received += block.rows
        self.complete = block.last
        return gap


class Subscriber:
    """Row blocks of a rig, in order.

    latest  None: every block is kept until it is received (tests, replay checks, own processing: keep up, or memory grows);
            k: only the newest k blocks are kept, and what was overwritten counts as missed (viewers: never stale)
    """

    def __init__(self, session: zenoh.Session, keys: Keys, *, latest: int | None = None) -> None:
        from zenoh.handlers import RingChannel

        self.tally = Tally()
        self._blocks: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._ring = latest is not None
        handler: Any = self._keep if latest is None else RingChannel(latest)
        self._subscriber: Any = session.declare_subscriber(keys.rows, handler)

    def receive(self, timeout: float | None = None) -> RowBlock | None:
        """The next block, waiting at most ``timeout`` s (None: for ever); None if there was none.

        With ``latest`` it never waits. ValueError: somebody publishes something else under our key.
        """
        data = self._newest() if self._ring else self._wait(timeout)
        if data is None:
            return None
        block = decode(data)
        self.tally.add(block)
        return block

    def close(self) -> None:
        """Ends the subscription."""
        self._subscriber.undeclare()

    def __enter__(self) -> Subscriber:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _keep(self, sample: zenoh.Sample) -> None:
        self._blocks.put(sample.payload.to_bytes())

    def _wait(self, timeout: float | None) -> bytes | None:
        try:
            return self._blocks.get(timeout=timeout)
        except queue.Empty:
            return None

    def _newest(self) -> bytes | None:
        sample = self._subscriber.try_recv()
        return None if sample is None else sample.payload.to_bytes()
