"""Levels near its largest value at which the rows of a current pile up, and its visits to such a level.

A clipped current stays at its limit for as long as the servo asks for more. That of a smooth crest does not: near a
parabola's maximum, 2.3 times as many rows are at the level as just below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr

from arm_io.types import Array

FLAT_SECONDS = 0.03
"""s for which a clipped current is constant once."""
AT_SECONDS = 1.0
"""s for which it is constant in all, where there are few visits."""
PILED = 4.0
"""Rows at a limit over those in an equally wide range below, at least."""
BEYOND = 0.03
"""Share of the rows at a limit that noise may lift above it: 0.02 of them exceed three noises where half of the
variance is slower than the noise that is measured. The crests of a slow current rise beyond their commonest value."""
FAR, FAR_SECONDS = 6.0, 0.0125
"""Noises above a limit, and s of rows that far: no noise lifts them there, however long the current is at it, and one
wrong row fills 0.01 s of an averaged current."""
AGAIN = 0.25
"""Share of the rows at a limit that lie outside its longest visit, at least: a smooth crest comes once, or again at
another value."""
CHANCE = 0.25
"""Share of the visits of a healthy current to the level of its largest pile that are flat there: 4 of 60 other than the
longest, in slow motions."""
UNLIKELY = 0.01
"""Probability below which so many flat visits are no chance."""
SHARP = 20.0
"""Rows at a limit in one visit over those in an equally wide range below, at which it is entered and left sharply: a
crest as flat as an eighth power has 14."""
SEVERAL = 2
"""Sharp visits that a healthy current does not make: none of 339 joints of healthy recordings, moves and waves of six
arms, has one."""
TOP = 0.9995
"""Share of the rows below which levels are tried."""
LEVELS = 25
"""Levels that are tried."""


@dataclass(frozen=True)
class Pile:
    """A level near the largest value of a joint's averaged current at which its rows pile up.

    level  A, with its noise; at, below, beyond, far: s of rows within two noises of it, from 8 to 4 below, more than 3
           above, and more than ``FAR`` above
    turns  of a visit: the joint reverses where it begins or ends, and so may its friction
    """

    level: float
    noise: float
    at: float
    below: float
    beyond: float
    far: float
    turns: bool = False

    @property
    def flat(self) -> bool:
        """As a clipped current is: near a smooth maximum (a parabola) 2.3 times as many rows are at it as below."""
        return self.at > max(PILED * self.below, FLAT_SECONDS) and not self.exceeded

    @property
    def exceeded(self) -> bool:
        """Whether more rows are above it than noise lifts there."""
        return self.beyond >= BEYOND * self.at or self.far_exceeded

    @property
    def far_exceeded(self) -> bool:
        """Whether rows are so far above it that it is no limit, whatever the visits to it are like."""
        return self.far > FAR_SECONDS

    @property
    def high(self) -> bool:
        """Whether it stays at the level for longer than a smooth maximum would."""
        return self.flat and self.at > AT_SECONDS

    def of(self, values: Array, period: float) -> Pile:
        """The pile at the same level of other currents (m,), ``period`` s between them."""
        away = (values - self.level) / self.noise
        rows = np.abs(away) < 2.0, (away > -8.0) & (away < -4.0), away > 3.0, away > FAR
        at, below, beyond, far = (float(np.count_nonzero(part)) * period for part in rows)
        return Pile(self.level, self.noise, at, below, beyond, far)

    def holds(self, values: Array) -> NDArray[np.bool_]:
        """(m,) rows that are at the level but for their noise."""
        return np.asarray(np.abs(values - self.level) < 4.0 * self.noise)


def pile_of(values: Sequence[Array], noise: float, period: float) -> Pile:
    """The highest pile of |currents| (m,) of recordings, among levels near their largest; ``period`` s between rows."""
    y = np.concatenate(values) if values else np.empty(0)
    if not len(y):
        return Pile(0.0, noise, 0.0, 0.0, 0.0, 0.0)
    top = float(np.quantile(y, TOP))
    levels = np.linspace(top - 6.0 * noise, top, LEVELS)
    level = float(levels[np.argmax([np.sum(np.abs(y - tried) < 2.0 * noise) for tried in levels])])
    at = np.abs(y - level) < 2.0 * noise
    level = float(np.median(y[at])) if at.any() else level
    return Pile(level, noise, 0.0, 0.0, 0.0, 0.0).of(y, period)


def reached_again(visits: Sequence[Pile]) -> bool:
    """Whether enough of the rows at a pile lie outside its longest visit."""
    at = [visit.at for visit in visits]
    return sum(at) - max(at, default=0.0) >= AGAIN * sum(at) > 0.0


def flat_visits(visits: Sequence[Pile]) -> bool:
    """Whether more visits to a level are flat than those of a healthy current by chance (binomial test).

    The longest visit is left out, because the level may have been chosen by it.
    """
    longest = max((visit.at for visit in visits), default=0.0)
    flat = [visit.flat for visit in visits if FLAT_SECONDS <= visit.at < longest]
    return any(flat) and 1.0 - float(bdtr(sum(flat) - 1, len(flat), CHANCE)) < UNLIKELY


def sharp_visits(visits: Sequence[Pile]) -> bool:
    """Whether several visits are entered and left sharply, but not by friction; lower crests are not asked."""
    sharp = [visit for visit in visits if visit.at > max(SHARP * visit.below, FLAT_SECONDS) and not visit.turns]
    beyond, at = sum(visit.beyond for visit in sharp), sum(visit.at for visit in sharp)
    return len(sharp) >= SEVERAL and beyond < BEYOND * at
