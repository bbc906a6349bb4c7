"""A sliding window over rows that are numbered from 0."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class History:
    """The last ``keep`` rows (at least) of a growing table of rows of one shape, addressed by their number."""

    def __init__(self, row: tuple[int, ...], keep: int, dtype: Any = float) -> None:
        self.keep = keep
        self.first = 0  # number of the oldest row held
        self._rows = np.empty((2 * keep, *row), dtype)
        self._held = 0

    def __len__(self) -> int:
        return self._held

    @property
    def end(self) -> int:
        """Number of the next row to come."""
        return self.first + self._held

    def append(self, rows: NDArray[Any]) -> None:
        """Adds (m, ...) rows at the end; the oldest make room."""
        if self._held + len(rows) > len(self._rows):
            stay = min(self._held, self.keep)
            needed = stay + len(rows)
            old = self._rows[self._held - stay : self._held]
            if needed > len(self._rows):
                self._rows = np.empty((2 * needed, *self._rows.shape[1:]), self._rows.dtype)
            self._rows[:stay] = old  # numpy buffers where the two overlap
            self.first += self._held - stay
            self._held = stay
        self._rows[self._held : self._held + len(rows)] = rows
        self._held += len(rows)

    def restart(self, number: int) -> None:
        """Forgets all rows; the next one appended has this number."""
        self.first, self._held = number, 0

    def truncate(self, end: int) -> None:
        """Forgets the rows from number ``end`` on."""
        self._held = min(self._held, max(end - self.first, 0))

    def __getitem__(self, numbers: NDArray[np.int64]) -> NDArray[Any]:
        """Rows by number, any shape of numbers; IndexError where one is forgotten or not there yet."""
        return self._rows[self._places(numbers)]

    def at(self, numbers: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[Any]:
        """Single entries of rows, where numbers and columns broadcast."""
        return self._rows[self._places(numbers), columns]

    def _places(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        place = numbers - self.first
        if place.size and (place.min() < 0 or place.max() >= self._held):
            raise IndexError(f"rows {self.first} to {self.end - 1} are held")
        return place

    @property
    def last(self) -> NDArray[Any]:
        """The newest row."""
        return self._rows[self._held - 1]
