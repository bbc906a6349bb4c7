"""Histories as charts: values with two deviations, the fitted trend with its band, the limits."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, timedelta

import numpy as np

from arm_io.types import Array
from arm_report import Chart, Level, Panel, Series
from arm_report.palette import AFTER, BEFORE, MEASURED
from comparison.trend.forecast import FARTHEST, trend_row, value_and_std
from comparison.trend.history import Histories
from comparison.trend.movement import Movement

POINTS = 200
"""Points of a drawn trend."""
MOST_AHEAD = 2.0
"""A forecast is drawn this many times as far ahead as the results go back, at most."""


def histories_chart(histories: Histories, shown: Sequence[Movement], name: str, title: str, columns: int = 2) -> Chart:
    """One panel per quantity."""
    panels = tuple(_panel(histories, one) for one in shown)
    return Chart(name=name, title=title, panels=panels, columns=columns, height=2.4)


def _panel(histories: Histories, one: Movement) -> Panel:
    history = one.moved.history
    days = np.unique(np.concatenate([np.linspace(history.days[0], _end(one), POINTS), history.days]))
    fitted = np.array([value_and_std(one.moved, trend_row(one.moved, day)) for day in days])
    words = history.quantity.words
    return Panel(
        series=(
            Series(
                x=_seconds(histories, days),
                y=fitted[:, 0],
                two_std=2 * fitted[:, 1],
                colour=AFTER if one.significant else MEASURED,
                label="fitted trend",
                width=1.2,
            ),
            Series(
                x=_seconds(histories, history.days),
                y=np.asarray(history.values, float),
                two_std=2 * np.asarray(history.std, float),
                kind="dots",
                colour=AFTER,
                label="results, two standard deviations",
            ),
        ),
        title=words if len(words) < 58 else f"{words[:55]}...",
        x="date",
        y=history.quantity.unit or "1",
        levels=tuple(
            Level(value=its.limit, colour=BEFORE, dashed=True, label="limit")
            for its in one.reaches
            if its.limit is not None
        ),
        joint=history.quantity.joint,
        dates=True,
    )


def _seconds(histories: Histories, days: Array) -> Array:
    start = histories.start if histories.start.tzinfo else histories.start.replace(tzinfo=UTC)
    return np.array([(start + timedelta(days=float(day))).timestamp() for day in days])


def _end(one: Movement) -> float:
    """The last day drawn: where a limit is reached, unless that is far ahead."""
    last = float(one.moved.history.days[-1])
    reached = [its.day for its in one.reaches if its.day is not None]
    if not reached:
        return last
    return min(1.1 * max(reached), (1 + MOST_AHEAD) * max(last, 1.0), FARTHEST)
