"""Levels near its largest value at which the rows of a current pile up, and its visits to such a level.

A clipped current stays at its limit for as long as the servo asks for more. That of a smooth crest does not: near a
parabola's maximum, 2.3 times as many rows are at the level as just below it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, ndtr

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
FLAT_VISITS = 3
"""Flat visits to the level above which nothing is (``edge_of``), but for those at a reversal, that a healthy current
does not make: none of 414 joints has two, and one in 25 has one."""
TOP = 0.9995
"""Share of the rows below which levels are tried, and no fewer than one wrong row and ``FAR_SECONDS`` leave."""
LEVELS = np.arange(-6.0, 0.01, 0.25)
"""Noises above that row: levels that are tried."""
SPREADS = np.array([0.5, 0.7, 1.0])
"""Std of the rows at a level that are tried, in noises, because noise that is slower counts twice in these."""
REACH, BIN = 14.0, 0.1
"""Noises below that row from which on rows decide, and in which they are counted."""
WRONG = 1e-6
"""Density per noise of rows that are neither at a level nor below it."""
ROUNDS = 20
"""Times that the share of the rows at a level is computed again."""


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
    top = _top(y, period)
    levels = top + LEVELS * noise
    level = float(levels[np.argmax([np.sum(np.abs(y - tried) < 2.0 * noise) for tried in levels])])
    at = np.abs(y - level) < 2.0 * noise
    level = float(np.median(y[at])) if at.any() else level
    return Pile(level, noise, 0.0, 0.0, 0.0, 0.0).of(y, period)


def edge_of(values: Sequence[Array], noise: float, period: float) -> Pile:
    """The rows of |currents| (m,) at the most likely level at which they end, as of ``pile_of``.

    A share of the rows is at it, the others are spread evenly below (a mixture, by maximum likelihood). Where as many
    are just below, the commonest value is a noise too low, and visits to the level rise above it.
    """
    y = np.concatenate(values) if values else np.empty(0)
    if not len(y):
        return Pile(0.0, noise, 0.0, 0.0, 0.0, 0.0)
    top = _top(y, period)
    edges = np.arange(-REACH, FAR + BIN, BIN)
    rows, at = np.histogram((y - top) / noise, edges)[0], edges[:-1] + BIN / 2
    level, std = (each.ravel()[:, None] for each in np.meshgrid(LEVELS, SPREADS))
    away = (at - level) / std
    piled, spread = np.exp(-0.5 * away**2) / (np.sqrt(2.0 * np.pi) * std), ndtr(-away) / (level + REACH)
    share = np.full_like(level, 0.5)
    for _ in range(ROUNDS):
        mixed = share * piled + (1.0 - share) * spread + WRONG
        share = share * ((piled / mixed) @ rows)[:, None] / max(int(rows.sum()), 1)
    likelihood = np.log(share * piled + (1.0 - share) * spread + WRONG) @ rows
    best = float(level[np.argmax(likelihood), 0])
    return Pile(top + best * noise, noise, 0.0, 0.0, 0.0, 0.0).of(y, period)


def _top(y: Array, period: float) -> float:
    """The largest of currents (m,), but for what noise or a wrong row make."""
    above = min(max(round((1.0 - TOP) * len(y)), math.ceil(FAR_SECONDS / period)), len(y) - 1)
    return float(np.partition(y, len(y) - 1 - above)[len(y) - 1 - above])


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


def ends_flat(visits: Sequence[Pile]) -> bool:
    """Whether enough visits to the level above which nothing is (``edge_of``) are flat, but not by friction."""
    return sum(visit.flat and not visit.turns for visit in visits) >= FLAT_VISITS
