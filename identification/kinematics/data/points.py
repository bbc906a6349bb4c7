"""Tracked points: joint coordinates and positions of the same triggers, as estimation takes them."""

from __future__ import annotations

from dataclasses import dataclass

from arm_io.types import Array
from identification.kinematics.models.chain import Index, Mask


@dataclass(frozen=True)
class Points:
    """Tracked points: q (N, joints) rad or m as recorded, xyz (N, 3) m.

    Deflections (N, joints, extensions) per unit.
    """

    q: Array
    xyz: Array
    deflections: Array | None = None

    def __len__(self) -> int:
        return len(self.q)

    def where(self, rows: Index | Mask | slice) -> Points:
        """Some of the points."""
        bent = None if self.deflections is None else self.deflections[rows]
        return Points(self.q[rows], self.xyz[rows], bent)

    def bent(self, extension: Array) -> Array:
        """Joint coordinates (N, joints) with deflections applied, for extension parameters (extensions,)."""
        if self.deflections is None or not len(extension):
            return self.q
        return self.q + self.deflections @ extension
