"""Tracked points: joint coordinates and what the tracker measured at the same triggers, as estimation takes them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from identification.kinematics.models.chain import Index, Mask

FIRST_LEVER = 0.2
"""m per rad before any residual is known: 30 um and 0.15 mrad, a laser tracker with a 6-D probe."""


@dataclass(frozen=True)
class Points:
    """Tracked points: q (N, joints) rad or m as recorded, xyz (N, 3) m.

    deflections  (N, joints, extensions) per unit
    target       (N,) number of the target (reflector) that each row is about, from 0; None: there is one
    lever        (N,) m: 0 for a position. For an orientation, xyz is its rotation vector (rad), and an error of 1 rad
                 counts as one of ``lever`` metres: the noise of positions over that of orientations. None: positions
    std          m, stated standard deviation of a coordinate: the noise is estimated, and is at least this
    """

    q: Array
    xyz: Array
    deflections: Array | None = None
    target: Index | None = None
    lever: Array | None = None
    std: float = 0.0

    def __len__(self) -> int:
        return len(self.q)

    @property
    def oriented(self) -> Mask:
        """(N,) bool: rows that are orientations."""
        return np.zeros(len(self), bool) if self.lever is None else np.asarray(self.lever > 0, bool)

    def where(self, rows: Index | Mask | slice) -> Points:
        """Some of the points."""
        bent = None if self.deflections is None else self.deflections[rows]
        target = None if self.target is None else self.target[rows]
        lever = None if self.lever is None else self.lever[rows]
        return Points(self.q[rows], self.xyz[rows], bent, target, lever, self.std)

    def deflected(self, deflections: Array | None) -> Points:
        """The same points with other deflections (N, joints, extensions)."""
        return replace(self, deflections=deflections)

    def bent(self, extension: Array) -> Array:
        """Joint coordinates (N, joints) with deflections applied, for extension parameters (extensions,)."""
        if self.deflections is None or not len(extension):
            return self.q
        return self.q + self.deflections @ extension
