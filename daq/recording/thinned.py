"""Rows averaged while they are read, so that a recording of any length needs bounded memory.

Positions and currents go through the same filter, the mean of successive rows, so that the equations between them hold
as before: six joints sampled at 20 kHz say little about the arm that they do not say at 1 kHz once each row is the mean
of twenty, noise included.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray]

MOST_NUMBERS = 7_200_000
"""Rows times joints that an analysis keeps of each signal: all rows of six joints at 1 kHz for 20 minutes."""
LEFT_OUT = ("counts", "volts", "host_ns", "tick", "extra")
"""Columns that no analysis looks at: raw readings, their clocks, and a table's further columns."""


class Thinned:
    """Columns of at most ``most_rows`` rows, each the mean of ``factor`` successive rows of the file.

    ``factor`` doubles whenever the columns are full.

    Of two rows with a missing sample in one, the other's is taken. Where triggers are missing between two rows, the
    first alone is kept: a mean over a gap is no sample of either side. Quality bits are those of any row; ``number`` is
    the first row's.
    """

    def __init__(self, most_rows: int) -> None:
        self.factor = 1
        self._most = max(2, most_rows - most_rows % 2)
        self._buffers: Columns = {}
        self._waiting: Columns = {}
        self._filled = 0

    def append(self, piece: Columns) -> None:
        """Takes the rows (k, ...) that follow those taken before."""
        rows = {name: values for name, values in piece.items() if name not in LEFT_OUT}
        if self._waiting:
            rows = {name: np.concatenate([self._waiting[name], values]) for name, values in rows.items()}
        else:
            self._buffers = {name: values[:0] for name, values in rows.items()}
        begin, count = 0, len(rows["number"])
        while count - begin >= self.factor:
            groups = min((count - begin) // self.factor, self._most - self._filled)
            if groups == 0:
                self._halve()
                continue
            end = begin + groups * self.factor
            self._put({name: values[begin:end] for name, values in rows.items()}, groups)
            begin = end
        self._waiting = {name: values[begin:].copy() for name, values in rows.items()}

    def arrays(self) -> Columns:
        """Column -> (n, ...). The last rows of the file, fewer than ``factor``, are in none of them."""
        return {name: values[: self._filled] for name, values in self._buffers.items()}

    def _put(self, rows: Columns, groups: int) -> None:
        step = 1
        while step < self.factor:
            rows, step = _halved(rows, step), 2 * step
        end = self._filled + groups
        for name, values in rows.items():
            if end > len(self._buffers[name]):
                self._buffers[name] = self._longer(self._buffers[name], end)
            self._buffers[name][self._filled : end] = values
        self._filled = end

    def _longer(self, buffer: NDArray, needed: int) -> NDArray:
        """Doubles the arrays, up to the limit: a short recording needs no more memory than it fills."""
        longer = np.empty((min(self._most, max(2 * len(buffer), needed)), *buffer.shape[1:]), buffer.dtype)
        longer[: self._filled] = buffer[: self._filled]
        return longer

    def _halve(self) -> None:
        for name, values in _halved(self._buffers, self.factor).items():
            self._buffers[name][: len(values)] = values
        self._filled //= 2
        self.factor *= 2


def _halved(rows: Columns, step: int) -> Columns:
    """Means of pairs of rows (2k, ...), whose trigger numbers lie ``step`` apart where none is missing."""
    torn = rows["number"][1::2] - rows["number"][::2] != step
    return {name: _paired(name, values, torn) for name, values in rows.items()}


def _paired(name: str, values: NDArray, torn: NDArray[np.bool_]) -> NDArray:
    first, second = values[::2], values[1::2]
    if name == "number":
        return first
    if name == "quality":
        return first | second
    torn = torn.reshape(-1, *[1] * (values.ndim - 1))
    if values.dtype.kind in "iu":
        return np.where(torn, first, first + (second - first) // 2)
    mean = 0.5 * (first + second)
    mean = np.where(np.isnan(mean), np.where(np.isnan(first), second, first), mean)
    return np.where(torn, first, mean)
