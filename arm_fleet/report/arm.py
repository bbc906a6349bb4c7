"""The page of an arm that changed: histories of the changed quantities, and the nights with their reports."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from arm_fleet.judging.alarms import Alarm
from arm_fleet.judging.verdicts import Condition, Verdict
from arm_fleet.tasks.store import TaskLine
from arm_report import Report, table
from comparison.trend import histories_chart

MOST_PANELS = 12
"""Maximum number of histories on the page."""


def arm_page(arm: Verdict, tasks: Sequence[TaskLine], alarms: Sequence[Alarm]) -> Report:
    """Page of an arm that changed: histories of its changed quantities, and its nights with their reports."""
    changed = {change.quantity.name for one in alarms if one.named for change in one.changes} | {*arm.moving}
    charts = []
    for trend in arm.trends:
        shown = [movement for movement in trend.movements if movement.moved.history.quantity.name in changed]
        shown += [one for one in trend.limited if one not in shown]
        if shown:
            title = f"{trend.histories.what}: what changed, or has a limit"
            charts.append(histories_chart(trend.histories, shown[:MOST_PANELS], trend.histories.what, title))
    now = arm.condition is Condition.CHANGED
    says = (
        f"{arm.cause}: changed since {arm.since}."
        if now
        else (f"{arm.cause}: changed from {arm.since} to {arm.until}, and agrees with its reference nights since then.")
    )
    return Report(
        title=f"{arm.arm}: {arm.condition}",
        template="arm_fleet.report/arm.html",
        content={
            "says": says[:1].upper() + says[1:] if arm.cause else "",
            "refuted": now,
            "moved": list(arm.moved),
            "actions": list(arm.actions),
            "charts": charts,
            "nights": _nights(tasks, alarms),
        },
    )


def arm_file(arm: str) -> str:
    """Path of the page of an arm, relative to the folder; names of arms may have spaces and colons."""
    return f"arms/{''.join(c if c.isalnum() or c in '.+-' else '_' for c in arm)}.html"


def link(place: str | None, words: str) -> Markup:
    """A link; only the words if there is no address."""
    if not place:
        return Markup.escape(words)
    return Markup('<a href="{}">{}</a>').format(place, words)


def unbroken(words: str) -> Markup:
    """A date that is not broken into two lines."""
    return Markup('<span class="u">{}</span>').format(words)


def _nights(tasks: Sequence[TaskLine], alarms: Sequence[Alarm]) -> Markup:
    judged = {one.key: one for one in alarms}
    rows = []
    for task in sorted(tasks, key=lambda one: one.night):
        alarm = judged.get(task.key)
        rows.append(
            [
                link(task.report and f"../{task.report}", unbroken(task.night or "baseline")),
                task.verdict if task.reason == "" else f"{task.state}: {task.reason}",
                task.causes,
                "" if alarm is None else f"{alarm.corrected:.2g}",
                "changed" if alarm is not None and alarm.named else "",
            ]
        )
    return table(rows, ["night", "verdict", "causes", "p corrected", ""], [3])
