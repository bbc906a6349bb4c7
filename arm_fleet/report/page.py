"""fleet.html, and a page per arm that changed: each one file that opens without a network."""

from __future__ import annotations

from collections import Counter
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from arm_fleet.report.text import tasks, verdict
from arm_report import Chart, Panel, Report, Series, table
from arm_report.palette import AFTER, MEASURED
from comparison.trend import histories_chart

if TYPE_CHECKING:
    from arm_fleet.fleet import Fleet
    from arm_fleet.judging.verdicts import Verdict

MOST_NIGHTS = 60
"""Latest nights of the map of nights."""
MOST_ARMS = 400
"""Arms of the map of nights and of the table of all arms; fleet.json has all."""
MOST_PANELS = 12
"""Histories on the page of an arm."""
MARKS = {"named": "●", "compared": "·", "failed": "×", "reference": "○"}


def fleet_page(fleet: Fleet) -> Report:
    """The whole fleet."""
    changed = fleet.changed
    returned = [one for one in fleet.verdicts if one.since and one not in changed]
    failed = [[one["arm"], one["night"] or "baseline", one["state"], one["reason"]] for one in fleet.failed]
    return Report(
        title=f"{fleet.plan.name}: which arms changed",
        template="arm_fleet.report/fleet.html",
        content={
            "what": tasks(fleet),
            "says": verdict(fleet),
            "refuted": bool(changed),
            "notes": list(fleet.notes),
            "changed": _changed(fleet, changed) if changed else None,
            "actions": [(one.arm, one.actions) for one in fleet.verdicts if one.actions],
            "returned": [f"{one.arm}: {one.cause}, named {one.since} to {one.until}" for one in returned],
            "limits": [(one.arm, s) for one in fleet.verdicts for s in one.moved if ": limit " in s],
            "chart": _named_per_night(fleet),
            "nights": _map(fleet),
            "marks": MARKS,
            "failed": failed,
            "left_out": max(0, len(fleet.verdicts) - MOST_ARMS),
        },
    )


def arm_page(fleet: Fleet, arm: Verdict) -> Report:
    """One arm: histories of what moved, and its nights with their reports."""
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
            "nights": _nights(fleet, arm),
        },
    )


def arm_file(arm: str) -> str:
    """Of the page of an arm, relative to the folder; names of arms may have spaces and colons."""
    return f"arms/{''.join(c if c.isalnum() or c in '.+-' else '_' for c in arm)}.html"


def _changed(fleet: Fleet, changed: list[Verdict]) -> Markup:
    rows = []
    for one in changed:
        rows.append(
            [
                _link(arm_file(one.arm), one.arm) if one.trends else one.arm,
                one.cause,
                one.since,
                one.moved[0] if one.moved else "",
                f"{one.p or 0.0:.2g}",
                _report(fleet, one.key),
            ]
        )
    return table(rows, ["arm", "cause", "named since", "how fast", "p corrected", "last night"], [4])


def _report(fleet: Fleet, key: str | None, up: str = "") -> Markup:
    """A link to the report of a night, where it has one."""
    record = next((one for one in fleet.records if one["key"] == key), None)
    if record is None:
        return Markup()
    name = next((file for file in ("diagnosed/report.html", "identified/report.html") if file in record["files"]), None)
    night = Markup.escape(record["night"])
    return night if name is None else _link(f"{up}results/{key}/{name}", record["night"])


def _link(place: str, words: str) -> Markup:
    return Markup('<a href="{}">{}</a>').format(place, words)


def _nights(fleet: Fleet, arm: Verdict) -> Markup:
    judged = {one.night: one for one in fleet.alarms if one.arm == arm.arm}
    rows = []
    for record in sorted((one for one in fleet.records if one["arm"] == arm.arm), key=lambda one: str(one["night"])):
        alarm, value = judged.get(record["night"]), record["value"]
        causes = ", ".join(
            one["effect"].replace("_", " ") + (f" of joint {one['joint']}" if one["joint"] else "")
            for one in value.get("causes", [])
        )
        rows.append(
            [
                _report(fleet, record["key"], "../"),
                record["state"] if record["reason"] == "" else f"{record['state']}: {record['reason']}",
                value.get("verdict", ""),
                causes,
                "" if alarm is None else f"{alarm.corrected:.2g}",
                "named" if alarm is not None and alarm.named else "",
            ]
        )
    return table(rows, ["night", "task", "verdict", "causes", "p corrected", ""], [4])


def _named_per_night(fleet: Fleet) -> Chart | None:
    """How many arms are named per night."""
    nights = sorted({one.night for one in fleet.alarms})
    if not nights:
        return None
    named = Counter(one.night for one in fleet.alarms if one.named)
    compared = Counter(one.night for one in fleet.alarms)
    x = np.array([datetime.fromisoformat(night).replace(tzinfo=UTC).timestamp() for night in nights])
    series = tuple(
        Series(x=x, y=np.array([float(counts[night]) for night in nights]), kind="both", colour=colour, label=label)
        for counts, colour, label in ((named, AFTER, "named"), (compared, MEASURED, "compared"))
    )
    panel = Panel(series=series, x="night", y="arms", dates=True)
    return Chart(name="named", title="arms that are called changed, per night", panels=(panel,))


def _map(fleet: Fleet) -> Markup:
    """Arms over their latest nights, a mark in each."""
    nights = sorted({one["night"] for one in fleet.records if one["night"]})[-MOST_NIGHTS:]
    marks: dict[tuple[str, str], str] = {}
    for record in fleet.records:
        marks[record["arm"], record["night"]] = MARKS["reference" if record["state"] == "done" else "failed"]
    for one in fleet.alarms:
        marks[one.arm, one.night] = MARKS["named" if one.named else "compared"]
    rows = [[one.arm, *(marks.get((one.arm, night), "") for night in nights)] for one in fleet.verdicts[:MOST_ARMS]]
    return table(rows, ["arm", *(night[5:] for night in nights)])
