"""When a drift will reach a limit, with an interval of 95 %."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from arm_io import InputError
from arm_io.types import Array
from comparison.trend.selection import Moved

FARTHEST = 36_500.0
"""days from the first result: later dates are not stated."""


@dataclass(frozen=True)
class Limit:
    """A value that a quantity must not pass: ``value`` in its unit, or a share of its first value (``relative``)."""

    name: str
    value: float
    relative: bool = False

    @classmethod
    def of(cls, text: str) -> Limit:
        """'joint3.coulomb=12' or 'joint3.coulomb=+50%'; InputError for anything else."""
        name, equals, number = text.rpartition("=")
        share = number.endswith("%")
        try:
            value = float(number.removesuffix("%"))
        except ValueError:
            value = math.nan
        if not name or not equals or not math.isfinite(value) or (share and value == 0):
            raise InputError("--limit", f"must be NAME=VALUE or NAME=+50% of the first value (is {text!r})")
        return cls(name, value / 100 if share else value, share)


@dataclass(frozen=True)
class Reach:
    """Where a quantity stands with respect to its limit; days count from the first result.

    passed   whether the fitted value of the last result is beyond it
    day      when the drift reaches it; None: it does not drift towards it
    between  the interval of 95 %; None at its end: the drift may also never reach it
    """

    limit: float
    passed: bool
    day: float | None
    between: tuple[float, float | None] | None


def trend_row(one: Moved, day: float) -> Array:
    """(p,) how the fitted value at any day follows from the coefficients; steps count from the result they begin with.

    -inf: the value before anything moved.
    """
    row = [1.0]
    for term in one.fit.terms:
        begin = float(one.history.days[term.at])
        row.append(max(day - begin, 0.0) if term.shape == "drift" else float(day >= begin))
    return np.array(row)


def slope_row(one: Moved) -> Array:
    """(p,) how the present drift per day follows from the coefficients."""
    return np.array([0.0, *(float(term.shape == "drift") for term in one.fit.terms)])


def value_and_std(one: Moved, row: Array) -> tuple[float, float]:
    """A linear combination of the coefficients and its standard deviation, two of which hold 95 %."""
    variance = float(row @ one.fit.covariance @ row)
    # Deviations that allow for few blocks are wider than the raw ones by this factor.
    widened = float(np.median(one.history.std / one.history.raw))
    return float(row @ one.fit.coefficients), widened * math.sqrt(max(variance, 0.0))


def reach(one: Moved, limit: Limit) -> Reach:
    """When the fitted history reaches the limit."""
    first = value_and_std(one, trend_row(one, -math.inf))[0]
    bound = first + abs(first) * limit.value if limit.relative else limit.value
    last = float(one.history.days[-1])
    now, _ = value_and_std(one, trend_row(one, last))
    towards = 1.0 if bound >= first else -1.0
    if towards * (now - bound) >= 0:
        return Reach(bound, True, None, None)
    slope, _ = value_and_std(one, slope_row(one))
    drifts = any(term.shape == "drift" for term in one.fit.terms)
    if not drifts or towards * slope <= 0:
        return Reach(bound, False, None, None)
    day = last + (bound - now) / slope
    if day > FARTHEST:
        return Reach(bound, False, None, None)
    return Reach(bound, False, day, _between(one, bound, towards, day))


def _between(one: Moved, bound: float, towards: float, day: float) -> tuple[float, float | None]:
    """First and last day at which the limit is within the band of 95 % about the drift (Fieller's interval)."""
    quantile = float(stats.t.ppf(0.975, max(min(one.freedom, 1e6), 1.0)))

    def outside(at: float, side: float) -> float:
        """Below 0 until the edge of the band passes the limit."""
        value, std = value_and_std(one, trend_row(one, at))
        return towards * (value - bound) + side * quantile * std

    last = float(one.history.days[-1])
    early = last if outside(last, 1.0) >= 0 else _crossing(lambda at: outside(at, 1.0), last, day)
    late = None if outside(FARTHEST, -1.0) < 0 else _crossing(lambda at: outside(at, -1.0), day, FARTHEST)
    return early, late


def _crossing(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function that changes sign between two days is zero."""
    from scipy import optimize

    return float(optimize.brentq(function, low, high))


def limits_of(limits: Sequence[Limit], found: Sequence[Moved]) -> dict[str, Reach]:
    """Name of a quantity -> where it stands; InputError for a limit of a quantity that no history has."""
    known = {one.history.quantity.name: one for one in found}
    stands = {}
    for limit in limits:
        if limit.name not in known:
            alike = [name for name in known if limit.name.lower() in name.lower()] or list(known)
            hint = ", ".join(alike[:6]) + (" ..." if len(alike) > 6 else "")
            raise InputError("--limit", f"{limit.name} is no quantity of these results; they have {hint}")
        stands[limit.name] = reach(known[limit.name], limit)
    return stands
