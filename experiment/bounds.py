"""What a stretch of a demand can ask for at most, without looking at every instant of it.

A check looks at a demand every ``STEP``: positions q(t), speeds |q(t + STEP) - q(t)| / STEP, and accelerations over
``FELT``, by which shorter corners are rounded: |q(t + 2 FELT) - 2 q(t + FELT) + q(t)| / FELT^2. The bounds are never
below what such a look finds:

    speed         sup |q'|; a jump by J adds J / STEP
    acceleration  the second difference is the mean of q'' weighted by a triangle 2 FELT wide and 1 / FELT high: at most
                  sup |q''|, and D / FELT more where the speed jumps by D in the window, J / FELT^2 where the position
                  does
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array

STEP = 1e-3
"""s between two looks at a demand."""
FELT = 0.02
"""s: an arm does not follow corners of a demand that are shorter.

Its acceleration is that between instants so far apart.
"""


@dataclass(frozen=True)
class Bounds:
    """Of n joints, (n,) each.

    low, high  rad (m): positions lie between
    speed      rad/s; acceleration: rad/s2 between corners
    corner     rad/s2 that corners add within any window of 2 FELT; 0 without corners
    """

    low: Array
    high: Array
    speed: Array
    acceleration: Array
    corner: Array

    @property
    def reach(self) -> Array:
        """(4, n) what a check compares with its limits: -low, high, speed, acceleration with corners."""
        return np.stack([-self.low, self.high, self.speed, self.acceleration + self.corner])

    def shifted(self, by: Array) -> Bounds:
        """The same motion elsewhere."""
        return Bounds(self.low + by, self.high + by, self.speed, self.acceleration, self.corner)


def resting(q: Array) -> Bounds:
    """Of standing at q (n,)."""
    none = np.zeros_like(q)
    return Bounds(q, q, none, none, none)


def joined(parts: Sequence[Bounds], shortest: float) -> Bounds:
    """Of parts that follow one another; ``shortest`` s: the duration of the shortest.

    A window that is shorter than every part sees the corners of two neighbours at most; of more, nothing is promised.
    """
    if len(parts) == 1:
        return parts[0]
    corners = np.stack([part.corner for part in parts])
    corner = corners.max(axis=0)
    several = (corners > 0).sum(axis=0) > 1
    return Bounds(
        np.min([part.low for part in parts], axis=0),
        np.max([part.high for part in parts], axis=0),
        np.max([part.speed for part in parts], axis=0),
        np.max([part.acceleration for part in parts], axis=0),
        np.where(several, 2 * corner if shortest >= 2 * FELT else np.inf, corner),
    )
