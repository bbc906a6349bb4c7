"""Which trigger made a row: from the device's numbers, and from the intervals between its rows.

A card numbers the edges that it has seen. If its input misses one, its numbers go on without a gap, but one interval is
twice as long, and from then on every row would be joined with its neighbour's. So the index of a row is its number plus
the edges that the intervals show to have been missed (or minus extra ones: interference on the line looks like an
edge).

    x = (t - t0) / period - (number - number0)      0 for a row on the grid; +1 for good after a missed edge, -1 after
                                                    an extra one

A single row that is stamped late has x = 1 too, and its successor x = 0: only what lasts for ``LASTING`` rows counts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]

SETTLE = 8
"""Rows before the period of a device's clock is known."""
LATER = 64
"""Rows by which stamps that were uneven at first are judged again."""
LASTING = 3
"""Rows for which a shift must last."""
REGULAR = 0.25
"""Of a period: intervals that scatter more cannot show a missed edge."""
TAIL = 0.3
"""Of a period: rows at the end of a batch that are further off wait for their successors."""
MOST_HELD = 16
"""Rows that may wait for their successors."""
UNSURE = 6.0
"""Standard deviations by which a first look at the period must differ from the rig file's to be believed."""


@dataclass
class Indexer:
    """Indices of one device's rows since arming.

    period_ns  expected interval of triggers, ns of the host
    numbered   False: the device does not number its rows, they are counted in the order of their arrival
    regular    True once the stamps have shown to be even enough to find missed edges; None before that is known
    unguarded  rows that came while they were not: whether an edge of these was missed is unknown
    missed     indices of edges that the device's input did not see; ``extra`` counts edges that were none
    period     interval of triggers by the clock that is used: the device's ticks where it has them, else host ns
    """

    period_ns: float
    numbered: bool = True
    regular: bool | None = None
    unguarded: int = 0
    missed: set[int] = field(default_factory=set)
    extra: int = 0
    period: float = 0.0
    _ticks: bool = False
    _shift: int = 0
    _count: int = 0  # rows counted, where the device does not number them
    _first: tuple[float, int] | None = None  # clock and index of the first row
    _last: tuple[float, int] = (0.0, 0)  # clock and number of the newest row, on the grid
    _uneven: list[tuple[Ints, Ints, Ints]] = field(default_factory=list)  # number, host, tick of the newest rows

    def index(self, number: Ints, host: Ints, tick: Ints, final: bool = False) -> tuple[Ints, NDArray[np.bool_]]:
        """Trigger indices of the first m rows of a batch, and which of these m to keep (extra edges are not kept).

        number, host, tick  (n,) rows of the device in order, as in ``drivers.protocols.Block``
        final               no more rows will come: decide on all of them

        Returns (m,) indices and (m,) bool. Where m < n the rest must be given again, with the rows that follow: either
        the period is not yet known, or the last rows may belong to a shift that has to be seen to last.
        """
        parts = []
        begin, size = 0, self._carries()
        while begin < len(number):
            stop = min(begin + size, len(number))
            rows = slice(begin, stop)
            part = self._index_some(number[rows], host[rows], tick[rows], final and stop == len(number))
            if len(part[0]):
                parts.append(part)
                begin, size = begin + len(part[0]), self._carries()
            elif stop == len(number):
                break
            else:
                size *= 2
        if len(parts) == 1:
            return parts[0]
        if not parts:
            return number[:0], np.empty(0, bool)
        return np.concatenate([index for index, _ in parts]), np.concatenate([keep for _, keep in parts])

    def _carries(self) -> int:
        """Number of further rows over which the period is known precisely enough.

        A period that was estimated from n rows is good for about n more.
        """
        return 1 << 30 if self.regular is not True else max(self._count, SETTLE)

    def _index_some(self, number: Ints, host: Ints, tick: Ints, final: bool) -> tuple[Ints, NDArray[np.bool_]]:
        n = len(number)
        if n == 0 or (self.regular is None and n < SETTLE and not final):
            return number[:0], np.empty(0, bool)
        if not self.numbered:
            number = self._count + np.arange(n)
        if self.regular is None:
            self._settle(number, host, tick)
        clock = tick if self._ticks else host
        if self._first is None:
            self._first = float(clock[0]), int(number[0]) + self._shift
            self._last = float(clock[0]), int(number[0])
        if not self.regular:
            self._count += n
            self._settle_later(number, host, tick)
            return number + self._shift, np.ones(n, bool)
        x = np.asarray((clock - self._last[0]) / self.period - (number - self._last[1]), np.float64)
        m, step = (n, np.zeros(n, np.int64)) if np.abs(x).max() < TAIL else _lasting_steps(x, final)
        if m == 0:
            return number[:0], np.empty(0, bool)
        step, off_grid = step[:m], (x - step)[:m]
        index = number[:m] + self._shift + step
        keep = self._note_steps(index, step, np.abs(off_grid)) if step.any() else np.ones(m, bool)
        self._advance(float(clock[m - 1]), int(number[m - 1]), int(index[-1]), off_grid)
        self._shift += int(step[-1])
        self._count += m
        return index, keep

    def _settle(self, number: Ints, host: Ints, tick: Ints) -> None:
        """Learns the period, and whether the stamps are even."""
        self._ticks = bool(tick.any())
        self.period = self.period_ns
        if len(number) < 2:
            self.regular = False
            return
        clock = tick if self._ticks else host
        intervals = np.diff(clock)
        median = float(np.median(intervals / np.maximum(np.diff(number), 1)))
        self.regular = median > 0 and bool(np.median(np.abs(intervals / np.diff(number) / median - 1)) < REGULAR)
        if not self.regular:
            return
        steps = np.round(intervals / median)  # counts missed edges too
        self.period = float(clock[-1] - clock[0]) / float(steps.sum())
        # A few uneven intervals determine the period less well than the rig file states it.
        scatter = float(np.std(np.cumsum(intervals / self.period - steps)))
        nominal = self.period_ns * float(clock[-1] - clock[0]) / max(float(host[-1] - host[0]), 1.0)
        if abs(self.period / nominal - 1) < UNSURE * scatter / len(steps):
            self.period = nominal

    def _settle_later(self, number: Ints, host: Ints, tick: Ints) -> None:
        """Judges uneven stamps again later: at the start of a run a computer is busy."""
        self.unguarded = self._count
        self._uneven.append((number, host, tick))
        rows = tuple(np.concatenate(column) for column in zip(*self._uneven))
        if len(rows[0]) < LATER:
            return
        self._uneven.clear()
        self._settle(*(column[-LATER:] for column in rows))
        if self.regular:
            newest = float(rows[2 if self._ticks else 1][-1])
            self._first, self._last = (newest, int(rows[0][-1]) + self._shift), (newest, int(rows[0][-1]))

    def _note_steps(self, index: Ints, step: Ints, off_grid: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Notes missed and extra edges; of two rows on one index keeps the one that lies on the grid."""
        keep = np.ones(len(index), bool)
        jumps = np.diff(step, prepend=0)
        for row in np.flatnonzero(jumps > 0):
            self.missed.update(range(int(index[row] - jumps[row]), int(index[row])))
        for row in np.flatnonzero(jumps < 0):
            same = np.flatnonzero(index[:row] >= index[row])
            worst = same[np.argmax(off_grid[same])] if len(same) else row
            keep[worst if off_grid[worst] > off_grid[row] else row] = False
            self.extra += 1
        return keep

    def _advance(self, clock: float, number: int, index: int, off_grid: NDArray[np.float64]) -> None:
        """Moves the grid to the newest row, by the mean of the good stamps, since its own stamp may be late."""
        good = off_grid[np.abs(off_grid) < TAIL]
        on_grid = clock - float(off_grid[-1] - (good.mean() if len(good) else 0.0)) * self.period
        self._last = on_grid, number
        assert self._first is not None
        if index - self._first[1] > 2 * SETTLE:
            self.period = (on_grid - self._first[0]) / (index - self._first[1])

    def move(self, edges: int) -> None:
        """Moves all further indices by ``edges``: the first row was not made by the first trigger."""
        self._shift += edges
        if self._first is not None:
            self._first = self._first[0], self._first[1] + edges


def _lasting_steps(x: NDArray[np.float64], final: bool) -> tuple[int, Ints]:
    """Whole steps of x that last for LASTING rows, and up to which row (exclusive) they are certain."""
    n = len(x)
    windows = np.lib.stride_tricks.sliding_window_view(np.append(x, [x[-1]] * (LASTING - 1)), LASTING)
    low, high = windows.min(axis=1), windows.max(axis=1)
    step = np.where(low > 0.5, np.round(low), np.where(high < -0.5, np.round(high), 0.0)).astype(np.int64)
    if final:
        return n, step
    # What follows the last row that is certainly on the grid is certain as far as it lies on the same level.
    certain = np.flatnonzero(np.abs(x - step)[: max(n - LASTING + 1, 0)] < TAIL)
    first, level = (int(certain[-1]) + 1, step[certain[-1]]) if len(certain) else (0, 0)
    if first == 0 and n > MOST_HELD:
        return n, step
    m = n
    while m > first and abs(x[m - 1] - level) > TAIL:
        m -= 1
    return m, step
