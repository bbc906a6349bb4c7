"""Plot of a parameter over time, with its standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any

from arm_report.notebook import drawing
from arm_report.palette import AFTER, GRID

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def history_figure(rows: Sequence[dict[str, Any]]) -> Figure:
    """Plots values with two standard deviations over the date; ``rows``: at least one, of ``Archive.history``.

    Hollow: a value without a standard deviation.
    """
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    figure = drawing(10, 3.6)
    axis = figure.subplots()
    for known in (True, False):
        shown = [row for row in rows if (row["std"] is not None) == known]
        if shown:
            dates = [datetime.fromisoformat(row["date"]) for row in shown]
            bars = [2 * row["std"] for row in shown] if known else None
            axis.errorbar(
                dates,  # type: ignore[arg-type]
                [row["value"] for row in shown],
                bars,
                fmt="o",
                ms=4,
                lw=1.0,
                capsize=2,
                color=AFTER,
                mfc=AFTER if known else "none",
            )
    locator = AutoDateLocator()
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    axis.grid(color=GRID)
    axis.set_axisbelow(True)
    axis.set_title(f"{rows[0]['name']}: {len(rows)} results, bars: two standard deviations", loc="left", fontsize=10)
    axis.set_ylabel(rows[0]["unit"] or "1")
    return figure
