"""Where a quantity stands with respect to its limits, and when a drift will reach them, with an interval of 95 %."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy import stats

from arm_io import InputError
from arm_io.types import Array
from comparison.trend.limits import Limit, Side
from comparison.trend.onsets import averaged, each
from comparison.trend.selection import Moved

FARTHEST = 36_500.0
"""days from the first result: later dates are not stated."""
OUTSIDE = 0.025
"""Chance at each end of an interval."""


class State(StrEnum):
    """Of a quantity with respect to a limit."""

    PASSED_AT_FIRST = "passed since the first result"
    PASSED = "passed"
    AHEAD = "will be reached"
    NOT_REACHED = "not reached at the present trend"
    UNCLEAR = "not said whether it is an upper or a lower one"
    NO_SHARE = "a share of a first value that is not different from zero"


@dataclass(frozen=True)
class Reach:
    """Where a quantity stands with respect to a limit; days count from the first result.

    limit    in the unit of the quantity; None: a share of a first value that is not different from zero
    side     upper: must not be exceeded; lower: must not fall below
    day      when the drift reaches it; None: it does not drift towards it, or is beyond it
    between  the interval of 95 %; None at its end: the drift may also never reach it
    """

    asked: Limit
    limit: float | None
    side: Side
    state: State
    day: float | None = None
    between: tuple[float, float | None] | None = None

    @property
    def passed(self) -> bool:
        """Whether the fitted value of the last result is beyond it."""
        return self.state in (State.PASSED, State.PASSED_AT_FIRST)


def trend_row(one: Moved, day: float) -> Array:
    """(m, p) the row that maps the coefficients to the fitted value on ``day``, for each of m combinations of onsets.

    A step counts from the result at which it begins; -inf gives the value before any change.
    """
    columns = [np.ones(len(one.onsets.weights))]
    for k, term in enumerate(one.fit.terms):
        begin = one.onsets.begins[:, k]
        columns.append(np.maximum(day - begin, 0.0) if term.shape == "drift" else np.asarray(day >= begin, float))
    return np.stack(columns, axis=1)


def slope_row(one: Moved) -> Array:
    """(1, p) how the present drift per day follows from the coefficients."""
    return np.array([[0.0, *(float(term.shape == "drift") for term in one.fit.terms)]])


def value_and_std(one: Moved, row: Array) -> tuple[float, float]:
    """A linear combination of the coefficients and its standard deviation, two of which hold 95 %."""
    return averaged(one.onsets, row)


def reach(one: Moved, limit: Limit) -> Reach:
    """Where the fitted history stands, and when it reaches the limit.

    A limit that does not say its side is a lower one where the first value is clearly above it (two deviations), else
    an upper one. Where the first value is not clearly below it and nothing moves across it or towards it, an upper
    limit may be meant that was passed all the time: that is ``State.UNCLEAR``.
    """
    first, doubt = value_and_std(one, trend_row(one, -np.inf))
    doubt *= 2
    if limit.relative and abs(first) <= doubt:
        return Reach(limit, None, limit.side or ("upper" if limit.value > 0 else "lower"), State.NO_SHARE)
    bound = first + abs(first) * limit.value if limit.relative else limit.value
    side = limit.side or ("lower" if bound < first - doubt else "upper")
    towards = 1.0 if side == "upper" else -1.0
    last = float(one.history.days[-1])
    now, _ = value_and_std(one, trend_row(one, last))
    if towards * (now - bound) >= 0:
        beyond = towards * (first - bound) > doubt
        return Reach(limit, bound, side, State.PASSED_AT_FIRST if beyond else State.PASSED)
    slope, _ = value_and_std(one, slope_row(one))
    day = last + (bound - now) / slope if towards * slope > 0 else np.inf
    if day > FARTHEST:
        unsaid = limit.side is None and not limit.relative and bound <= first + doubt
        return Reach(limit, bound, side, State.UNCLEAR if unsaid else State.NOT_REACHED)
    return Reach(limit, bound, side, State.AHEAD, float(day), _between(one, bound, towards, float(day)))


def _between(one: Moved, bound: float, towards: float, day: float) -> tuple[float, float | None]:
    """First and last day between which, at 95 %, it is undecided whether the limit is reached.

    With one onset this is Fieller's interval; with several, their probabilities are averaged.
    """
    degrees = max(min(one.freedom, 1e6), 1.0)

    def chance(at: float) -> float:
        """That the fitted value is beyond the limit."""
        values, std = each(one.onsets, trend_row(one, at))
        return float(one.onsets.weights @ stats.t.cdf(towards * (values - bound) / std, degrees))

    last = float(one.history.days[-1])
    early = last if chance(last) >= OUTSIDE else _crossing(lambda at: chance(at) - OUTSIDE, last, day)
    if chance(FARTHEST) < 1 - OUTSIDE:
        return early, None
    return early, _crossing(lambda at: chance(at) - 1 + OUTSIDE, day, FARTHEST)


def _crossing(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function that rises from below zero is zero; an end where it does not change sign."""
    from scipy import optimize

    if function(low) >= 0:
        return low
    if function(high) <= 0:
        return high
    return float(optimize.brentq(function, low, high))


def limits_of(limits: Sequence[Limit], found: Sequence[Moved]) -> dict[str, tuple[Reach, ...]]:
    """Name of a quantity -> where it stands with each of its limits; InputError: no history has such a quantity."""
    moved_by_name = {one.history.quantity.name: one for one in found}
    stands: dict[str, tuple[Reach, ...]] = {}
    for limit in dict.fromkeys(limits):
        if limit.name not in moved_by_name:
            alike = [name for name in moved_by_name if limit.name.lower() in name.lower()] or list(moved_by_name)
            hint = ", ".join(alike[:6]) + (" ..." if len(alike) > 6 else "")
            raise InputError("--limit", f"{limit.name} is no quantity of these results; they have {hint}")
        stands[limit.name] = (*stands.get(limit.name, ()), reach(moved_by_name[limit.name], limit))
    return stands
