"""trend.html: one file that opens anywhere, without a network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markupsafe import Markup

from arm_report import Report, table
from arm_report.numbers import value_and_two_std
from comparison.report.html import quantity_cell
from comparison.trend.movement import MONTH, Movement
from comparison.trend.plots import histories_chart
from comparison.trend.text import limit_sentence, sentence, verdict
from comparison.wording import probability

if TYPE_CHECKING:
    from comparison.trend.outcome import Trend

MOST_PLOTS = 24
"""Quantities that did not move, drawn; all stand in the table."""


def report(trend: Trend) -> Report:
    """The whole page."""
    moved, limited = trend.moved, trend.limited
    shown = [*moved, *(one for one in limited if one not in moved)]
    still = [movement for movement in trend.movements if movement not in shown][:MOST_PLOTS]
    sentences = [sentence(one, trend.histories) for one in moved]
    sentences += [limit_sentence(one, its, trend.histories) for one in limited for its in one.reaches]
    first, last = trend.histories.date(0.0), trend.histories.date(_last(trend.movements))
    name = "" if trend.arm is None else f"{trend.arm.name}: "
    histories = trend.histories
    return Report(
        title=f"{name}what changed",
        template="comparison.trend/trend.html",
        joints=[] if trend.arm is None else [joint.name for joint in trend.arm.joints],
        content={
            "what": f"{len(histories.results)} {histories.what}, {first} to {last}.",
            "says": verdict(trend),
            "moved": bool(moved),
            "said": sentences,
            "warnings": histories.warnings,
            "shown": histories_chart(histories, shown, "moved", "histories of quantities that changed")
            if shown
            else None,
            "still": histories_chart(histories, still, "still", "histories of the other quantities", 3)
            if still
            else None,
            "quantities": _table(trend),
            "results": [[path] for path in histories.results],
        },
    )


def _last(movements: Sequence[Movement]) -> float:
    return max((float(movement.moved.history.days[-1]) for movement in movements), default=0.0)


def _table(trend: Trend) -> Markup:
    head = ["quantity", "results", "first", "last", "change", "2 std", f"drift per {MONTH:.0f} days", "2 std"]
    head += ["p corrected", "unit"]
    rows = []
    for one in trend.movements:
        history = one.moved.history
        rows.append(
            [
                quantity_cell(history.quantity),
                str(len(history.days)),
                value_and_two_std(*one.first)[0],
                value_and_two_std(*one.last)[0],
                *(value_and_two_std(*one.change, sign="+") if one.significant else ("", "")),
                *(("", "") if one.drift is None else value_and_two_std(*(MONTH * x for x in one.drift), sign="+")),
                probability(one.moved.corrected),
                Markup('<span class="u">{}</span>').format(history.quantity.unit),
            ]
        )
    weak = [k for k, one in enumerate(trend.movements) if not one.significant]
    return table(rows, head, range(1, 9), weak)
