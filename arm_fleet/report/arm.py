"""The page of an arm that changed: histories of what moved, its nights with their reports."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from arm_fleet.judging.alarms import Alarm
from arm_fleet.judging.verdicts import Verdict
from arm_fleet.tasks.store import TaskLine
from arm_report import Report, table
from comparison.trend import histories_chart

MOST_PANELS = 12
"""Histories on the page."""


def arm_page(arm: Verdict, tasks: Sequence[TaskLine], alarms: Sequence[Alarm]) -> Report:
    """Histories of what moved, and the nights with their reports."""
    charts = []
    for trend in arm.trends:
        shown = [*trend.moved, *(one for one in trend.limited if one not in trend.moved)][:MOST_PANELS]
        if shown:
            charts.append(
                histories_chart(
                    trend.histories, shown, trend.histories.what, f"{trend.histories.what}: histories of what moved"
                )
            )
    return Report(
        title=f"{arm.arm}: {arm.condition}",
        template="arm_fleet.report/arm.html",
        content={
            "says": f"{arm.cause}: {arm.condition}, named {arm.since} to {arm.until}." if arm.cause else "",
            "moved": list(arm.moved),
            "actions": list(arm.actions),
            "charts": charts,
            "nights": _nights(tasks, alarms),
        },
    )


def arm_file(arm: str) -> str:
    """Of the page of an arm, relative to the folder; names of arms may have spaces and colons."""
    return f"arms/{''.join(c if c.isalnum() or c in '.+-' else '_' for c in arm)}.html"


def link(place: str | None, words: str) -> Markup:
    """A link; the words alone where there is no place."""
    if not place:
        return Markup.escape(words)
    return Markup('<a href="{}">{}</a>').format(place, words)


def _nights(tasks: Sequence[TaskLine], alarms: Sequence[Alarm]) -> Markup:
    judged = {one.key: one for one in alarms}
    rows = []
    for task in sorted(tasks, key=lambda one: one.night):
        alarm = judged.get(task.key)
        rows.append(
            [
                link(task.report and f"../{task.report}", task.night or "baseline"),
                task.state if task.reason == "" else f"{task.state}: {task.reason}",
                task.verdict,
                task.causes,
                "" if alarm is None else f"{alarm.corrected:.2g}",
                "named" if alarm is not None and alarm.named else "",
            ]
        )
    return table(rows, ["night", "task", "verdict", "causes", "p corrected", ""], [4])
