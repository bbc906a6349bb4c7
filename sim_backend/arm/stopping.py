"""A demand that is cut short: from a time on, every joint slows down as fast as its ramps allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from experiment import Demand

_SPEED_OVER = 1e-3
"""s over which the demanded speed at the stop is taken."""


@dataclass(frozen=True)
class StoppedDemand:
    """``demand`` until ``at`` s, then slowing down from the speed it had to rest at deceleration (n,) rad/s2."""

    demand: Demand
    at: float
    deceleration: Array

    def __call__(self, times: Array) -> Array:
        """(k, n) rad at times (k,) s."""
        times = np.atleast_1d(times)
        return np.where((times <= self.at)[:, None], self.demand(times), self._slowing(times - self.at))

    @property
    def duration(self) -> float:
        """s until all joints rest."""
        return self.at + float((np.abs(self._speed()) / self.deceleration).max())

    def _speed(self) -> Array:
        begin = max(self.at - _SPEED_OVER, 0.0)
        now, before = self.demand(np.array([self.at, begin]))
        return (now - before) / max(self.at - begin, _SPEED_OVER)

    def _slowing(self, after: Array) -> Array:
        speed = self._speed()
        slowing = np.clip(after[:, None], 0.0, np.abs(speed) / self.deceleration)
        return self.demand(np.array([self.at])) + speed * slowing - np.sign(speed) * self.deceleration * slowing**2 / 2
