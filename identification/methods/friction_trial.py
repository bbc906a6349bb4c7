"""Whether a richer friction law is justified: two fits compared on held-out rows on which a joint slides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.methods.held_out import HeldOutResiduals
from identification.regression.equations import Equations
from identification.ripples.search import BY_CHANCE, MATTERS

REDUCED = 0.05
"""Of the rms error of a joint while it slides on held-out rows: what a richer law must take away to stay."""
LARGE, BY_CHANCE_IF_LARGE = 0.5, 0.05
"""Share of the error that a law leaves, at most, that may gain so by that chance: a short held-out recording has so few
blocks that all of them gain more often than ``BY_CHANCE``: eight, at each of four joints, in one of 64 cases."""
SLOWEST = 2.0
"""Times the lowest speed of a joint: slower rows are not free of the reversals beside them, and do not decide."""


@dataclass(frozen=True, kw_only=True)
class FrictionTrial:
    """A richer law tried at one joint (from 1): rms errors (N m, N) on held-out sliding rows, and whether it stays.

    straight: without it; curve: with it; None where it slides on no held-out row. why: what speaks against a law that
    has no such rows, or a smaller error; else empty.
    """

    joint: int
    straight: float | None
    curve: float | None
    p: float
    stays: bool
    why: str = ""

    def compared(self, unit: str) -> str:
        """What was compared, as a report says it, in unit (N m, N)."""
        if self.straight is None:
            return self.why
        return f"held-out error while it slides {self.straight:.3g} -> {self.curve:.3g} {unit}"


def trial_of(j: int, residuals: HeldOutResiduals, slowest: float, friction: float, tried: int) -> FrictionTrial:
    """Both fits at joint j (from 0) on held-out rows on which it slides; ``slowest``: rad/s (m/s), its lowest speed.

    friction: N m (N), its Coulomb friction; tried: joints at which the same is tried.
    """
    rows = residuals.rows
    compared = residuals.on((rows.joint == j) & (_speed(rows, j) > SLOWEST * slowest))
    if compared is None:
        return FrictionTrial(
            joint=j + 1, straight=None, curve=None, p=1.0, stays=False, why="it slides on no held-out row"
        )
    before, after, p = compared.before, compared.after, compared.p * tried
    removed = np.sqrt(max(before**2 - after**2, 0.0)) / friction
    seldom = BY_CHANCE_IF_LARGE if after < LARGE * before else BY_CHANCE
    smaller = after < (1.0 - REDUCED) * before
    justified = p < seldom and smaller and removed > MATTERS
    why = ""
    if smaller and not justified:
        why = f"noise alone gains as much with probability {min(p, 1.0):.1g}"
        if removed <= MATTERS:
            why = f"a gain of {removed:.1%} of its Coulomb friction"
    return FrictionTrial(joint=j + 1, straight=before, curve=after, p=compared.p, stays=bool(justified), why=why)


def _speed(rows: Equations, j: int) -> Array:
    """(rows,) rad/s (m/s) of joint j (from 0), as its columns of viscous friction have it."""
    viscous = [k for k, name in enumerate(rows.names) if name.startswith(f"joint{j + 1}.viscous")]
    return np.abs(rows.columns[:, viscous].sum(axis=1))
