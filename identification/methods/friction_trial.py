"""Whether a richer friction law is justified: two fits compared on rows on which a joint slides.

The error on held-out recordings must be smaller. That this is no chance is shown by all recordings, each stretch
predicted from the others (``held_out.cross_validated``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.methods.held_out import HeldOutResiduals
from identification.regression.equations import Equations
from identification.ripples.search import BY_CHANCE, MATTERS

REDUCED = 0.05
"""Of the rms error of a joint while it slides on held-out rows: what a richer law must take away to stay."""
SLOWEST = 2.0
"""Times the lowest speed of a joint: slower rows are not free of the reversals beside them, and do not decide."""


@dataclass(frozen=True, kw_only=True)
class FrictionTrial:
    """A richer law tried at one joint (from 1): rms errors (N m, N) on held-out sliding rows, and whether it stays.

    straight: without it; curve: with it; None where it slides on no held-out row. p: by all recordings. why: what
    speaks against a law that has no such rows, or a smaller error; else empty.
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


def trial_of(
    j: int, held_out: HeldOutResiduals, every: HeldOutResiduals, slowest: float, friction: float, tried: int
) -> FrictionTrial:
    """Both fits at joint j (from 0) on rows on which it slides; ``slowest``: rad/s (m/s), its lowest speed.

    held_out, every: residuals of held-out recordings, and of all of them by cross-validation; friction: N m (N), its
    Coulomb friction; tried: joints at which the same is tried.
    """
    compared, together = (one.on(_slides(one.rows, j, slowest)) for one in (held_out, every))
    if compared is None or together is None:
        return FrictionTrial(
            joint=j + 1, straight=None, curve=None, p=1.0, stays=False, why="it slides on no held-out row"
        )
    before, after, p = compared.before, compared.after, together.p * tried
    removed = np.sqrt(max(before**2 - after**2, 0.0)) / friction
    smaller = after < (1.0 - REDUCED) * before
    justified = p < BY_CHANCE and smaller and removed > MATTERS
    why = ""
    if smaller and not justified:
        why = f"noise alone gains as much with probability {min(p, 1.0):.1g}"
        if removed <= MATTERS:
            why = f"a gain of {removed:.1%} of its Coulomb friction"
    return FrictionTrial(joint=j + 1, straight=before, curve=after, p=together.p, stays=bool(justified), why=why)


def _slides(rows: Equations, j: int, slowest: float) -> NDArray[np.bool_]:
    """(rows,) of joint j (from 0), clearly faster than its lowest speed."""
    return np.asarray((rows.joint == j) & (rows.speed() > SLOWEST * slowest))
