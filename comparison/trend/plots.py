"""Histories as pictures: values with two deviations, the fitted trend with its band, the limit."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta
from typing import TYPE_CHECKING

import numpy as np

from arm_report.palette import AFTER, AXIS, BEFORE, GRID, MEASURED, PALE_AFTER
from comparison.trend.forecast import FARTHEST, trend_row, value_and_std
from comparison.trend.history import Histories
from comparison.trend.movement import Movement

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 200
MOST_AHEAD = 2.0
"""A forecast is drawn this many times as far ahead as the results go back, at most."""


def histories_figure(histories: Histories, shown: Sequence[Movement], *, columns: int = 2) -> Figure:
    """One plot per quantity."""
    from matplotlib.figure import Figure

    rows = -(-max(len(shown), 1) // columns)
    figure = Figure(figsize=(5.2 * columns, 2.7 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis, one in zip(axes, shown):
        _draw(axis, histories, one)
    for axis in axes[len(shown) :]:
        axis.set_visible(False)
    return figure


def _draw(axis: Axes, histories: Histories, one: Movement) -> None:
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    history = one.moved.history
    end = _end(one)
    days = np.unique(np.concatenate([np.linspace(history.days[0], end, POINTS), history.days]))
    fitted = np.array([value_and_std(one.moved, trend_row(one.moved, day)) for day in days])
    dates = [histories.start + timedelta(days=float(day)) for day in days]
    low, high = fitted[:, 0] - 2 * fitted[:, 1], fitted[:, 0] + 2 * fitted[:, 1]
    axis.fill_between(dates, low, high, color=PALE_AFTER, lw=0)  # type: ignore[arg-type]
    axis.plot(dates, fitted[:, 0], color=AFTER if one.significant else MEASURED, lw=1.2)  # type: ignore[arg-type]
    axis.errorbar(
        [histories.start + timedelta(days=float(day)) for day in history.days],  # type: ignore[arg-type]
        history.values,
        2 * history.std,
        fmt="o",
        ms=3,
        lw=0.8,
        capsize=1.5,
        color=AXIS,
    )
    if one.reach is not None:
        axis.axhline(one.reach.limit, color=BEFORE, lw=1.0, ls="--")
    locator = AutoDateLocator(minticks=3, maxticks=8)
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    axis.grid(color=GRID)
    axis.set_axisbelow(True)
    words = history.quantity.words
    axis.set_title(words if len(words) < 58 else f"{words[:55]}...", loc="left", fontsize="small")
    axis.set_ylabel(history.quantity.unit or "1", fontsize="small")
    axis.tick_params(labelsize="small")


def _end(one: Movement) -> float:
    """The last day drawn: where a limit is reached, unless that is far ahead."""
    last = float(one.moved.history.days[-1])
    if one.reach is None or one.reach.day is None:
        return last
    return min(1.1 * one.reach.day, (1 + MOST_AHEAD) * max(last, 1.0), FARTHEST)
