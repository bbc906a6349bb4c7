"""Wear of the arms of a simulated fleet: one parameter of one effect that grows night by night, and a repair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import EffectTerm


@dataclass(frozen=True, kw_only=True)
class Wear:
    """A kind of wear.

    effect, parameter  of the catalogue; joint: from 1
    fixed              other parameters of the effect, which do not change
    growth             increase of the parameter per night
    """

    name: str
    effect: str
    parameter: str
    joint: int
    growth: float
    fixed: tuple[tuple[str, float], ...] = ()

    def term(self, value: float) -> EffectTerm:
        """The effect in one night."""
        return EffectTerm(self.effect, self.joint, {**dict(self.fixed), self.parameter: value})

    @property
    def quantity(self) -> str:
        """Name of its parameter in an arm: 'joint1.backlash.half_gap'."""
        return f"joint{self.joint}.{self.effect}.{self.parameter}"


KINDS = (
    Wear(name="gap of a gear", effect="backlash", parameter="half_gap", joint=1, growth=8e-5),
    Wear(name="seal that dries", effect="coulomb_friction", parameter="coulomb", joint=2, growth=0.08),
    Wear(name="transducer that drifts", effect="current_gain", parameter="error", joint=1, growth=4e-3),
)
"""Kinds of wear of the two-link arm; each changes the current by three times the noise after some nights."""


@dataclass(frozen=True, kw_only=True)
class Life:
    """Wear and repair of one arm.

    wear      None: it stays healthy
    begins    night (from 0) after which it wears; repaired: first night after the repair, None: no repair
    """

    arm: str
    wear: Wear | None = None
    begins: int = 0
    repaired: int | None = None

    def values(self, nights: int) -> Array:
        """(nights,) of the parameter; 0: healthy."""
        if self.wear is None:
            return np.zeros(nights)
        k = np.arange(nights)
        grown = self.wear.growth * np.maximum(k - self.begins, 0.0)
        return np.where(k < (nights if self.repaired is None else self.repaired), grown, 0.0)


def lives(arms: int, nights: int, *, worn: float, seed: int) -> list[Life]:
    """Lives of a fleet: a share ``worn`` of the arms wears, each kind equally often; every second one is repaired.

    Wear begins in the first half, after five healthy nights. InputError for a fleet without arms or nights.
    """
    if arms < 1 or nights < 1:
        raise InputError("fleet-sim", f"needs at least one arm and one night (is {arms} and {nights})")
    draw = np.random.default_rng(seed)
    count = round(worn * arms)
    which = np.sort(draw.choice(arms, count, replace=False))
    fleet = [Life(arm=f"arm-{number:03d}") for number in range(1, arms + 1)]
    for place, number in enumerate(which):
        begins = int(draw.integers(5, max(6, nights // 2 + 1)))
        repaired = begins + max(4, int(0.7 * (nights - begins))) if place % 2 else None
        fleet[number] = Life(
            arm=fleet[number].arm,
            wear=KINDS[place % len(KINDS)],
            begins=begins,
            repaired=repaired if repaired is not None and repaired < nights else None,
        )
    return fleet
