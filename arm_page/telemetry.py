"""Telemetry of the rows: rate, rows that this page missed, channels with quality flags, fit of the clocks."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.acquisition import fit_clock
from drivers.protocols import Quality

SECOND_NS = 1_000_000_000
CLOCK_BLOCKS = 3000
"""Number of blocks in the clock fit, one reading per block: 30 s of blocks of 10 ms."""
DOUBTS = {
    Quality.MISSING: "missing",
    Quality.STALE: "stale",
    Quality.SATURATED: "saturated",
    Quality.QUADRATURE_ERROR: "quadrature error",
    Quality.LATE: "late",
    Quality.DEVICE_RESET: "device reset",
}


class Telemetry:
    """Figures of the newest second of rows.

    channels  names ``device.channel`` of the columns of ``quality``; empty: unknown here, numbers are used instead
    clock     name of the device whose ticks come with the rows
    """

    def __init__(self, channels: Sequence[str], clock: str) -> None:
        self._channels, self._clock = list(channels), clock
        self.begin()

    def begin(self) -> None:
        """Begins a new run."""
        self._blocks: deque[tuple[int, int, int, int, NDArray[np.int64]]] = deque()
        self._ticks: deque[tuple[int, int]] = deque(maxlen=CLOCK_BLOCKS)
        self._flags = np.zeros((0, len(DOUBTS)), np.int64)

    def add(self, columns: Mapping[str, NDArray]) -> None:
        """Adds the rows of one block."""
        host, number = columns["host_ns"], columns.get("number")
        if not len(host):
            return
        flags = np.zeros((0, len(DOUBTS)), np.int64)
        if "quality" in columns:
            quality = columns["quality"]
            flags = np.stack([(quality & int(flag) != 0).sum(axis=0) for flag in DOUBTS], axis=1)
        last = int(number[-1]) if number is not None else 0
        self._blocks.append((int(host[-1]), last, len(host), int(host[0]), flags))
        while self._blocks[0][0] < host[-1] - SECOND_NS:
            self._blocks.popleft()
        if "tick" in columns and columns["tick"][0]:
            self._ticks.append((int(columns["tick"][0]), int(host[0])))

    def table(self) -> dict[str, Any]:
        """Figures as plain data; rate: triggers/s in the last second, None without rows; clock: fit of the ticks."""
        return {"rate": self._rate(), "clock": self._fit(), "doubtful": self._doubtful()}

    def _rate(self) -> float | None:
        if len(self._blocks) < 2:
            return None
        (first_ns, first, *_), (last_ns, last, *_) = self._blocks[0], self._blocks[-1]
        return (last - first) / ((last_ns - first_ns) * 1e-9) if last_ns > first_ns and last > first else None

    def _fit(self) -> dict[str, Any] | None:
        fit = fit_clock(self._clock, list(self._ticks))
        if fit is None:
            return None
        return {
            "device": fit.device,
            "tick_rate": fit.tick_rate,
            "residual_us": fit.residual_rms * 1e-3,
            "std_us": max(fit.std_ns) * 1e-3,
            "readings": fit.pairs,
        }

    def _doubtful(self) -> list[dict[str, Any]]:
        """Channels with quality flags in the last second: name, flag, share of the rows."""
        kept = [block[4] for block in self._blocks if len(block[4])]
        if not kept:
            return []
        rows = sum(block[2] for block in self._blocks)
        counts = np.sum(kept, axis=0)
        return [
            {"channel": self._name(column), "doubt": word, "share": counts[column, k] / rows}
            for k, word in enumerate(DOUBTS.values())
            for column in np.flatnonzero(counts[:, k]).tolist()
        ]

    def _name(self, column: int) -> str:
        return self._channels[column] if column < len(self._channels) else f"column {column + 1}"
