"""How one quantity moved, in numbers and dates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from comparison.trend.forecast import Reach, slope_row, trend_row, value_and_std
from comparison.trend.history import Histories
from comparison.trend.onsets import interval
from comparison.trend.selection import Moved
from comparison.trend.terms import candidates, fit, tests

MONTH = 30.0
"""days, in which drifts are stated."""


@dataclass(frozen=True, kw_only=True)
class Onset:
    """One term: its shape, the value that it adds (a drift: per day), and when it began.

    after, by  days between which it began, with 95 %; a step: the last result before it and the first after
    """

    shape: str
    value: float
    std: float
    after: float
    by: float


@dataclass(frozen=True, kw_only=True)
class Movement:
    """One quantity: fitted first and last value, their difference, the present drift per day, each with its std."""

    moved: Moved
    first: tuple[float, float]
    last: tuple[float, float]
    change: tuple[float, float]
    drift: tuple[float, float] | None
    onsets: tuple[Onset, ...]
    reaches: tuple[Reach, ...]

    @property
    def significant(self) -> bool:
        """Whether the quantity moved."""
        return bool(self.moved.fit.terms)

    def reached_within(self, days: float) -> bool:
        """Whether a limit is passed, or will be at the present drift within so many days after the last result."""
        last = float(self.moved.history.days[-1])
        return any(reach.passed or (reach.day is not None and reach.day <= last + days) for reach in self.reaches)

    def to_json(self, histories: Histories) -> dict[str, Any]:
        history, quantity = self.moved.history, self.moved.history.quantity
        return {
            "name": quantity.name,
            "description": quantity.words,
            "joint": quantity.joint,
            "unit": quantity.unit,
            "moved": self.significant,
            "p": self.moved.p,
            "p_corrected": self.moved.corrected,
            "p_shape": self.moved.p_shape,
            "first": _pair(self.first),
            "last": _pair(self.last),
            "change": _pair(self.change),
            "drift_per_day": None if self.drift is None else _pair(self.drift),
            "since": [
                {
                    "shape": onset.shape,
                    "value": onset.value,
                    "std": onset.std,
                    "after": histories.date(onset.after),
                    "by": histories.date(onset.by),
                }
                for onset in self.onsets
            ],
            "limits": [_reach(reach, histories) for reach in self.reaches],
            "std_between_results": float(np.sqrt(self.moved.fit.between)),
            "history": [
                {"date": histories.date(day), "value": float(value), "std": float(std), "source": source}
                for day, value, std, source in zip(history.days, history.values, history.std, history.sources)
            ],
        }


def _pair(pair: tuple[float, float]) -> dict[str, float]:
    return {"value": pair[0], "std": pair[1]}


def _reach(reach: Reach, histories: Histories) -> dict[str, Any]:
    late = None if reach.between is None else reach.between[1]
    return {
        "value": reach.limit,
        "side": reach.side,
        "state": str(reach.state),
        "passed": reach.passed,
        "date": None if reach.day is None else histories.date(reach.day),
        "earliest": None if reach.between is None else histories.date(reach.between[0]),
        "latest": None if late is None else histories.date(late),
    }


def movement_of(moved: Moved, reaches: tuple[Reach, ...] = ()) -> Movement:
    """The numbers of one history."""
    days = moved.history.days
    begin = trend_row(moved, -math.inf)
    order = sorted(range(len(moved.fit.terms)), key=lambda k: moved.fit.terms[k].at)
    end = trend_row(moved, float(days[-1]))
    drifts = any(term.shape == "drift" for term in moved.fit.terms)
    return Movement(
        moved=moved,
        first=value_and_std(moved, begin),
        last=value_and_std(moved, end),
        change=value_and_std(moved, end - begin),
        drift=value_and_std(moved, slope_row(moved)) if drifts else None,
        onsets=tuple(_onset(moved, k) for k in order),
        reaches=reaches,
    )


def _onset(moved: Moved, k: int) -> Onset:
    """Term ``k`` with the interval in which it may have begun; of a step all places that fit nearly as well."""
    term, days = moved.fit.terms[k], moved.history.days
    value, std = value_and_std(moved, np.eye(len(moved.fit.coefficients))[None, k + 1])
    if term.shape == "drift":
        after, by = interval(moved.onsets, k, moved.freedom)
        return Onset(shape=term.shape, value=value, std=std, after=after, by=by)
    others = fit(moved.history, tuple(one for one in moved.fit.terms if one != term), moved.fit.between)
    same = [one for one in candidates(moved.history) if one.shape == term.shape and one not in others.terms]
    _, gain = tests(moved.history, others, same, moved.freedom)
    allowed = float(stats.chi2.ppf(0.95, 1))
    near = [one.at for one, its in zip(same, gain) if its >= max(gain) - allowed] or [term.at]
    low, high = min(near), max(near)
    # A step lies between two results.
    after = days[max(low - 1, 0)]
    return Onset(shape=term.shape, value=value, std=std, after=float(after), by=float(days[high]))
