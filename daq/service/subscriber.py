"""Rows from Zenoh, and an exact count of those that were missed."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from daq.service.row_block import RowBlock, decode
from daq.service.zenoh_session import Keys

if TYPE_CHECKING:
    import zenoh

QUEUE_BLOCKS = 8192
"""Blocks of rows that may wait for a reader: of 10 ms each, 80 s."""


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

    latest  None: blocks wait in a queue of 8192 (80 s) until they are received; who is slower than that misses some,
            and knows it. k: only the newest k blocks are kept, and what was overwritten counts as missed (viewers:
            never stale)
    """

    def __init__(self, session: zenoh.Session, keys: Keys, *, latest: int | None = None) -> None:
        from zenoh.handlers import FifoChannel, RingChannel

        self.tally = Tally()
        # Zenoh's own channels: a queue in Python would halve the throughput (two threads and one interpreter lock).
        channel: Any = FifoChannel(QUEUE_BLOCKS) if latest is None else RingChannel(latest)
        self._subscriber: zenoh.Subscriber[zenoh.Handler[zenoh.Sample]] = session.declare_subscriber(keys.rows, channel)

    def receive(self, timeout: float | None = None) -> RowBlock | None:
        """The next block, waiting at most ``timeout`` s (None: for ever); None if there was none.

        ValueError: something else is published under our key.
        """
        sample = self._subscriber.recv() if timeout is None else self._wait(timeout)
        if sample is None:
            return None
        block = decode(sample.payload.to_bytes())
        self.tally.add(block)
        return block

    def close(self) -> None:
        """Ends the subscription."""
        self._subscriber.undeclare()

    def __enter__(self) -> Subscriber:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _wait(self, timeout: float) -> zenoh.Sample | None:
        """Asks once a millisecond: Zenoh's channels wait for ever or not at all."""
        deadline = time.monotonic() + timeout
        while (sample := self._subscriber.try_recv()) is None and time.monotonic() < deadline:
            time.sleep(0.001)
        return sample
