"""Whether a richer friction law is justified: two fits compared on rows on which a joint slides.

The error on held-out recordings must be smaller. That this is no chance is shown by all recordings, each stretch
predicted from the others (``held_out.cross_validated``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from arm_io.types import Array
from identification.methods.held_out import Comparison, HeldOutResiduals
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


def trials_of(
    held_out: HeldOutResiduals, every: HeldOutResiduals, slowest: Mapping[int, float], sizes: Array
) -> list[FrictionTrial]:
    """Both fits at each joint (from 0) of ``slowest``, rad/s (m/s), its lowest speed, on rows on which it slides.

    held_out, every: residuals of held-out recordings, and of all of them by cross-validation; sizes (J,) N m (N):
    Coulomb friction of the joints. Of the laws that stay, ``BY_CHANCE`` are there by chance (Benjamini & Hochberg): the
    drives of an arm are much alike. Where no joint has a richer law, one gets it no more often than that.
    """
    compared: dict[int, tuple[Comparison, Comparison]] = {}
    for j, least in slowest.items():
        on, together = (one.on(_slides(one.rows, j, least)) for one in (held_out, every))
        if on is not None and together is not None:
            compared[j] = on, together
    chances = [together.p for _, together in compared.values()]
    chance = dict(zip(compared, stats.false_discovery_control(chances) if chances else ()))
    none = "it slides on no held-out row"
    return [
        _trial(j, *compared[j], float(chance[j]), float(sizes[j]))
        if j in compared
        else FrictionTrial(joint=j + 1, straight=None, curve=None, p=1.0, stays=False, why=none)
        for j in slowest
    ]


def _trial(j: int, compared: Comparison, together: Comparison, chance: float, friction: float) -> FrictionTrial:
    """At joint j (from 0): compared on held-out recordings, together on all; chance: corrected for all joints."""
    before, after = compared.before, compared.after
    removed = np.sqrt(max(before**2 - after**2, 0.0)) / friction
    smaller = after < (1.0 - REDUCED) * before
    justified = chance < BY_CHANCE and smaller and removed > MATTERS
    why = ""
    if smaller and not justified:
        why = f"noise alone gains as much with probability {chance:.1g}"
        if removed <= MATTERS:
            why = f"a gain of {removed:.1%} of its Coulomb friction"
    return FrictionTrial(joint=j + 1, straight=before, curve=after, p=together.p, stays=bool(justified), why=why)


def _slides(rows: Equations, j: int, slowest: float) -> NDArray[np.bool_]:
    """(rows,) of joint j (from 0), clearly faster than its lowest speed."""
    return np.asarray((rows.joint == j) & (rows.speed() > SLOWEST * slowest))
