"""A device's clock related to the host's: a continuous, piecewise-linear fit with its uncertainty.

Ticks are read once a block together with the host's time. The fit is the least-squares polyline through these pairs
with knots every ``KNOT_SECONDS``: crystals drift over minutes, so that a line of 10 s is straight to well below a
microsecond. The uncertainty of a knot is that of least squares with the residuals' own scatter; it says how well the
polyline is known, and ``residual_rms`` how far a single reading lies from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

KNOT_SECONDS = 10.0
MOST_PAIRS = 20_000
"""Of a long recording, evenly chosen."""


@dataclass(frozen=True)
class ClockFit:
    """Host time at device ticks, linear between knots.

    ticks         (k,) ticks of the device's clock at the knots
    host_ns       (k,) host's monotonic clock there
    std_ns        (k,) standard deviation of host_ns
    residual_rms  ns: scatter of single readings
    tick_rate     ticks per host second, over the whole fit
    pairs         readings that were kept, of a long recording an even choice
    """

    device: str
    ticks: tuple[int, ...]
    host_ns: tuple[int, ...]
    std_ns: tuple[float, ...]
    residual_rms: float
    tick_rate: float
    pairs: int

    def to_host(self, tick: NDArray[np.int64]) -> NDArray[np.int64]:
        """Host ns at ticks (n,); beyond the ends the outer lines go on."""
        knots, host = np.array(self.ticks), np.array(self.host_ns)
        segment = np.clip(np.searchsorted(knots, tick, side="right") - 1, 0, len(knots) - 2)
        slope = np.diff(host) / np.diff(knots)
        return host[segment] + np.round((tick - knots[segment]) * slope[segment]).astype(np.int64)

    def as_table(self) -> dict[str, Any]:
        """Plain data, as recordings keep it."""
        return {
            "device": self.device,
            "ticks": list(self.ticks),
            "host_ns": list(self.host_ns),
            "std_ns": [round(std, 1) for std in self.std_ns],
            "residual_rms_ns": round(self.residual_rms, 1),
            "tick_rate": self.tick_rate,
            "pairs": self.pairs,
        }


class ClockPairs:
    """Pairs (tick, host ns) of a run however long: every ``stride``-th of those added, at most ``MOST_PAIRS``.

    Whenever so many are there, every second one is dropped and the stride doubled: they stay evenly spread.
    """

    def __init__(self) -> None:
        self.kept: list[tuple[int, int]] = []
        self.stride = 1
        self.added = 0

    def add(self, tick: int, host: int) -> None:
        """A reading of the device's ticks at a time of the host, ns; every other one goes where there are too many."""
        if self.added % self.stride == 0:
            if len(self.kept) == MOST_PAIRS:
                del self.kept[1::2]
                self.stride *= 2
            if self.added % self.stride == 0:
                self.kept.append((tick, host))
        self.added += 1


def fit_clock(device: str, pairs: Sequence[tuple[int, int]], knot_seconds: float = KNOT_SECONDS) -> ClockFit | None:
    """The fit of (tick, host ns) pairs in order; None where there are fewer than three, or the ticks stand still."""
    if len(pairs) < 3:
        return None
    chosen = np.array(pairs, np.int64)[:: 1 + len(pairs) // MOST_PAIRS]
    ticks, host = chosen[:, 0], chosen[:, 1]
    if ticks[-1] <= ticks[0] or host[-1] <= host[0]:
        return None
    seconds = (host[-1] - host[0]) * 1e-9
    knots = np.linspace(0.0, 1.0, 1 + max(1, min(round(seconds / knot_seconds), len(ticks) // 3)))
    at = (ticks - ticks[0]) / (ticks[-1] - ticks[0])
    line = at * (host[-1] - host[0])  # least squares on the residual: 64-bit ns do not fit a float
    residual = (host - host[0]) - line
    hats = _hats(at, knots)
    normal = hats.T @ hats
    covariance = np.linalg.pinv(normal)
    bend = covariance @ (hats.T @ residual)
    scatter = residual - hats @ bend
    freedom = max(len(ticks) - len(knots), 1)
    variance = float(scatter @ scatter) / freedom
    knot_ticks = ticks[0] + np.round(knots * (ticks[-1] - ticks[0])).astype(np.int64)
    knot_host = host[0] + np.round(knots * (host[-1] - host[0]) + bend).astype(np.int64)
    return ClockFit(
        device=device,
        ticks=tuple(knot_ticks.tolist()),
        host_ns=tuple(knot_host.tolist()),
        std_ns=tuple(np.sqrt(variance * np.diag(covariance)).tolist()),
        residual_rms=float(np.sqrt(np.mean(scatter**2))),
        tick_rate=float((knot_ticks[-1] - knot_ticks[0]) / ((knot_host[-1] - knot_host[0]) * 1e-9)),
        pairs=len(pairs),
    )


def _hats(at: NDArray[np.float64], knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, k): how much each knot weighs at each place, in 0..1; rows sum to one."""
    width = knots[1] - knots[0]
    return np.clip(1.0 - np.abs(at[:, None] - knots) / width, 0.0, 1.0)


class ArrivalClock:
    """Times of triggers, estimated from the times at which their rows arrived, block by block.

    An arrival is never earlier than its trigger and often later.

    Follows the earliest arrivals on an even grid, and creeps later by at most CREEP, so that a slow trigger is followed
    too.
    """

    CREEP = 2e-3  # s per s

    def __init__(self, period_ns: float) -> None:
        self.period_ns = period_ns
        self._last: tuple[int, float] | None = None  # index and time of the last row

    def times(self, index: NDArray[np.int64], arrival: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) ns for rows (n,) given by their trigger's index and the arrival stamp; strictly increasing."""
        if len(index) == 0:
            return arrival
        if self._last is None:
            self._last = int(index[0]) - 1, float(arrival[-1] - self.period_ns * (index[-1] - index[0] + 1))
        at, time = self._last
        grid = time + (index - at) * self.period_ns
        slack = float((arrival - grid).min())
        creep = min(slack, self.CREEP * self.period_ns * float(index[-1] - at)) if slack > 0 else slack
        # An earlier arrival pulls the whole block, but never behind the rows that went before.
        grid += max(creep, -0.5 * self.period_ns)
        self._last = int(index[-1]), float(grid[-1])
        return np.round(grid).astype(np.int64)
