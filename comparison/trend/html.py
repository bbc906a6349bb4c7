"""trend.json and trend.html: one file that opens anywhere, without a network."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import arm_report
from arm_io import make_folder, write_text
from arm_report import image, note, page, table, warning
from comparison.trend.movement import MONTH, Movement
from comparison.trend.plots import histories_figure
from comparison.trend.text import chance, limit_sentence, sentence, verdict

if TYPE_CHECKING:
    from comparison.trend.outcome import Trend

MOST_PLOTS = 24
"""Quantities that did not move, drawn; all stand in the table."""
READING = (
    "Values of the results with two standard deviations; line and band: the fitted trend with two standard deviations; "
    "dashed: the limit. A quantity is called moved if a step or a drift beyond its joint deviations is "
    "significant after correction for all places at which it could begin and for the number of quantities "
    "(Benjamini and Hochberg)."
)


def write_trend(folder: str | PathLike[str], trend: Trend) -> dict[str, Any]:
    """Writes both files into ``folder`` (made if need be) and returns what trend.json says."""
    folder = Path(folder)
    make_folder(folder)
    content = trend.to_json()
    write_text(folder / "trend.html", report(trend))
    write_text(folder / "trend.json", json.dumps(content, indent=1, allow_nan=False) + "\n")
    return content


def report(trend: Trend) -> str:
    """The whole page."""
    moved, limited = trend.moved, trend.limited
    shown = [*moved, *(one for one in limited if one not in moved)]
    still = [one for one in trend.movements if one not in shown]
    sentences = [sentence(one, trend.histories) for one in moved]
    sentences += [limit_sentence(one, trend.histories) for one in limited]
    first, last = trend.histories.date(0.0), trend.histories.date(_last(trend.movements))
    body = [
        note(escape(f"{len(trend.histories.results)} {trend.histories.what}, {first} to {last}.")),
        arm_report.verdict(verdict(trend), refuted=bool(moved)),
        *(["<ul>", *(f"<li>{escape(one)}</li>" for one in sentences), "</ul>"] if sentences else []),
        *map(warning, trend.histories.warnings),
        note(READING),
        image(histories_figure(trend.histories, shown), "histories of what moved") if shown else "",
        "<h2>Every quantity</h2>",
        _table(trend),
        *_still(trend, still),
        "<h2>Results</h2>",
        table([[escape(path)] for path in trend.histories.results], ("by date",)),
    ]
    name = "" if trend.arm is None else f"{trend.arm.name}: "
    return page(f"{name}what moved", body)


def _last(movements: Sequence[Movement]) -> float:
    return max((float(one.moved.history.days[-1]) for one in movements), default=0.0)


def _still(trend: Trend, still: Sequence[Movement]) -> list[str]:
    if not still:
        return []
    figure = histories_figure(trend.histories, still[:MOST_PLOTS], columns=3)
    drawn = image(figure, "histories of what did not move")
    return [f"<details><summary>Histories of what did not move</summary>{drawn}</details>"]


def _table(trend: Trend) -> str:
    head = ["quantity", "results", "first", "last", "change", "2 std", f"drift per {MONTH:.0f} days", "2 std"]
    head += ["p corrected", "unit"]
    rows = []
    for one in trend.movements:
        history = one.moved.history
        rows.append(
            [
                f"{escape(history.quantity.words)}<br><small>{escape(history.quantity.name)}</small>",
                str(len(history.days)),
                f"{one.first[0]:.4g}",
                f"{one.last[0]:.4g}",
                f"{one.change[0]:+.3g}" if one.significant else "",
                f"{2 * one.change[1]:.2g}" if one.significant else "",
                "" if one.drift is None else f"{MONTH * one.drift[0]:+.3g}",
                "" if one.drift is None else f"{2 * MONTH * one.drift[1]:.2g}",
                escape(chance(one.moved.corrected)),
                f"<span class=u>{escape(history.quantity.unit)}</span>",
            ]
        )
    weak = [k for k, one in enumerate(trend.movements) if not one.significant]
    return table(rows, head, range(1, 9), weak)
