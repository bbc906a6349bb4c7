"""The rows of one device on their way to the join: indexed by trigger, counts extended to 64 bit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.clock_fit import ClockPairs
from daq.acquisition.trigger_index import Indexer
from daq.rig.channels import Columns
from drivers import extend
from drivers.protocols import Block, Quality

Table = dict[str, NDArray[Any]]
VALUES = ("counts", "volts", "points", "readings")
MISSING = int(Quality.MISSING)
"""A plain integer: numpy is slow with enum members."""


class Stream:
    """Rows of one device since arming.

    name      of the device
    columns   value -> columns of the joined rows that this device fills
    quality   columns of the joined quality that it fills
    required  a trigger without a row of this device is lost; a tracker's missing point is a value missing
    by_time   the device makes rows on its own time: the nearest serves a trigger. Other triggers that it is the nearest
              to get it too, marked STALE, but for a tracker's point and readings, which are MISSING there
    served    host time of the newest row that has served a trigger by time
    presets   channel -> count that its register was set to, where it was
    """

    def __init__(
        self, name: str, columns: Columns, period_ns: float, *, by_time: bool, presets: dict[int, int]
    ) -> None:
        self.name = name
        self.by_time = by_time
        counters = [i for i, (owner, _) in enumerate(columns.counters) if owner == name]
        inputs = [i for i, (owner, _) in enumerate(columns.inputs) if owner == name]
        points = [0, 1, 2] if columns.tracker == name else []
        readings = [i for i, (owner, _) in enumerate(columns.readings) if owner == name]
        self.columns = {k: slice(v[0], v[-1] + 1) for k, v in zip(VALUES, (counters, inputs, points, readings)) if v}
        first_input = len(columns.counters)
        last = first_input + len(columns.inputs)
        self.quality = np.array(counters + [first_input + i for i in inputs] + [last] * bool(points), int)
        self.required = not by_time and bool(counters or inputs)
        self.indexer = Indexer(period_ns)
        self.newest = -1  # index of the newest row that was indexed
        self.rows = 0
        self.served = -1
        self.repeat = Quality.MISSING if points or readings else Quality.STALE
        self.pairs = ClockPairs()  # one a block, for the fit of the clocks
        self._widths = [columns.widths[i] for i in counters]
        self._last: list[int | None] = [presets.get(columns.counters[i][1]) for i in counters]
        self._waiting: Table | None = None
        self.ready: Table | None = None

    def push(self, block: Block, final: bool = False) -> None:
        """Takes the rows of a read; ``final``: no more will come."""
        if len(block):
            self.rows += len(block)
            if block.tick[-1]:
                self.pairs.add(int(block.tick[-1]), int(block.host[-1]))
            self._waiting = append(self._waiting, self._table(block))
        waiting = self._waiting
        if waiting is None:
            return
        if self.indexer.regular is None and self.indexer.numbered:
            self.indexer.numbered = bool(waiting["number"][0] >= 0)
        if self.by_time:
            index, keep = waiting["number"], np.ones(len(waiting["number"]), bool)
        else:
            index, keep = self.indexer.index(waiting["number"], waiting["host"], waiting["tick"], final)
        if len(index) == 0:
            return
        head = cut(waiting, 0, len(index))
        self._waiting = cut(waiting, len(index), None) if len(index) < len(waiting["number"]) else None
        head["index"] = index
        if not keep.all():
            head = {name: column[keep] for name, column in head.items()}
        if "counts" in head:
            head["counts"] = self._extended(head["counts"], head["quality"])
        if len(head["index"]):
            self.newest = int(head["index"][-1])
            self.ready = append(self.ready, head)

    def move(self, edges: int) -> None:
        """Shifts the indices of everything that is ready and that will come."""
        self.indexer.move(edges)
        self.newest += edges
        if self.ready is not None:
            self.ready["index"] = self.ready["index"] + edges

    def drop_through(self, index: int) -> None:
        """Forgets the rows up to this index."""
        if self.ready is not None:
            start = int(np.searchsorted(self.ready["index"], index, side="right"))
            self.ready = cut(self.ready, start, None) if start < len(self.ready["index"]) else None

    def drop_before(self, host: int) -> None:
        """Of a device on its own time: forgets what is older than the newest row before this time."""
        if self.ready is not None:
            start = max(int(np.searchsorted(self.ready["host"], host)) - 1, 0)
            self.ready = cut(self.ready, start, None)

    def _table(self, block: Block) -> Table:
        table: Table = {"number": block.number, "host": block.host, "tick": block.tick, "quality": block.quality}
        for name in self.columns:
            value = getattr(block, name)
            if value is None:
                raise ValueError(f"{self.name}: its driver gave a block without {name}")
            table[name] = value
        return table

    def _extended(self, raw: NDArray[np.int64], quality: NDArray[np.uint8]) -> NDArray[np.int64]:
        out = np.empty_like(raw)
        gaps = bool((quality[:, : len(self._widths)] & MISSING).any())
        for c, width in enumerate(self._widths):
            shown, last = raw[:, c], self._last[c]
            if gaps:  # missing counts are placeholders: the previous count is used instead
                missing = (quality[:, c] & MISSING) != 0
                if missing.all():
                    out[:, c] = last or 0
                    continue
                newest = np.maximum.accumulate(np.where(missing, -1, np.arange(len(shown))))
                shown = shown[np.where(newest >= 0, newest, np.argmin(missing))]
            out[:, c] = extend(shown, width, int(shown[0]) if last is None else last)
            self._last[c] = int(out[-1, c])
        return out


def append(head: Table | None, tail: Table) -> Table:
    """Two tables of the same columns, one under the other."""
    if head is None:
        return tail
    return {name: np.concatenate([column, tail[name]]) for name, column in head.items()}


def cut(table: Table, start: int, stop: int | None) -> Table:
    """Rows ``start`` to ``stop`` of a table."""
    return {name: column[start:stop] for name, column in table.items()}
