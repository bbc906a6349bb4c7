"""Axes of pictures that are drawn here: where a value lies on one, and what is written beside it.

Linear, logarithmic, linear about zero and logarithmic beyond, and dates. ``arm_report.stills`` draws with them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from arm_io.types import Array

DAY = 86_400.0
DATE_STEPS = (1.0, 5.0, 15.0, 60.0, 300.0, 900.0, 3600.0, 10_800.0, 21_600.0, 43_200.0, DAY, 2 * DAY, 7 * DAY)
"""s: round distances of dates; beyond the last, twice it, and so on."""
ROOM = 0.04
"""Share of the range of the values that is added at both ends."""


@dataclass(frozen=True, kw_only=True)
class Scale:
    """An axis from ``low`` to ``high``; log, dates, linear and whole as in ``arm_report.chart.Panel``."""

    low: float
    high: float
    log: bool = False
    linear: float | None = None
    dates: bool = False
    whole: bool = False

    def place(self, values: Array | float) -> Array:
        """Share of the axis at which values lie: 0 at ``low``, 1 at ``high``; NaN where it has no place for them."""
        first, last = self._bent(self.low), self._bent(self.high)
        found: Array = (self._bent(values) - first) / (last - first)
        return found

    def _bent(self, values: Array | float) -> Array:
        x = np.asarray(values, float)
        if self.log:
            return np.log10(np.where(x > 0.0, x, np.nan))
        if self.linear is not None:
            size = np.abs(x) / self.linear
            return np.sign(x) * np.where(size > 1.0, 1.0 + np.log10(np.maximum(size, 1.0)), size)
        return x

    def ticks(self, most: int) -> list[tuple[float, str]]:
        """Round values on the axis in order, about ``most`` of them, with their texts."""
        if self.log:
            values = _decades(self.low, self.high, most)
        elif self.linear is not None:
            beyond = _decades(self.linear, max(abs(self.low), abs(self.high)), max(2, most // 2))
            values = [*(-x for x in reversed(beyond)), 0.0, *beyond]
        elif self.dates:
            return [(x, _date(x, self.high - self.low)) for x in _multiples(self.low, self.high, most, dates=True)]
        else:
            values = _multiples(self.low, self.high, most, dates=False, finest=1.0 if self.whole else 0.0)
        return [(x, written(x)) for x in values if self.low <= x <= self.high]


def written(value: float) -> str:
    """A tick in plain digits."""
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}")


def scale_of(
    values: list[Array],
    stated: tuple[float, float] | None,
    *,
    log: bool,
    linear: float | None,
    dates: bool,
    whole: bool = False,
) -> Scale:
    """The axis that shows these values, or the range stated for it."""
    low, high = stated if stated is not None and stated[0] < stated[1] else _range(values, log=log)
    return Scale(low=low, high=high, log=log, linear=linear, dates=dates, whole=whole)


def _range(values: list[Array], *, log: bool) -> tuple[float, float]:
    finite = np.concatenate([np.ravel(one) for one in values]) if values else np.empty(0)
    finite = finite[np.isfinite(finite) & ((finite > 0.0) | (not log))]
    if not len(finite):
        return (1.0, 10.0) if log else (0.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    if log:
        room = (high / low) ** ROOM if high > low else 2.0
        return low / room, high * room
    room = ROOM * (high - low) or 0.05 * abs(high) or 1.0
    return low - room, high + room


def _multiples(low: float, high: float, most: int, *, dates: bool, finest: float = 0.0) -> list[float]:
    """Multiples of the smallest round step, not below ``finest``, of which at most ``most`` fit."""
    least = max((high - low) / max(most, 1), finest)
    if dates:
        doubled = DATE_STEPS[-1] * 2.0 ** max(0, math.ceil(math.log2(max(least / DATE_STEPS[-1], 1.0))))
        step = next((one for one in DATE_STEPS if one >= least), doubled)
    else:
        power = 10.0 ** math.floor(math.log10(least))
        step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1 - 1e-9))
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def _decades(low: float, high: float, most: int) -> list[float]:
    """Powers of ten, each so many-eth; 1, 2 and 5 times them where there are few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    step = max(1, -(-(last - first) // max(most, 1)))
    factors = (1.0, 2.0, 5.0) if last - first <= max(1, most // 3) else (1.0,)
    values = [factor * 10.0**power for power in range(first, last + 1, step) for factor in factors]
    return [x for x in values if low * (1 - 1e-9) <= x <= high * (1 + 1e-9)]


def _date(seconds: float, span: float) -> str:
    at = datetime.fromtimestamp(seconds, UTC)
    return at.strftime("%Y-%m-%d" if span > 3 * DAY else "%m-%d %H:%M" if span > 3600.0 else "%H:%M:%S")
