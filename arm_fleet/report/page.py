"""fleet.html: the whole fleet in one file that opens without a network."""

from __future__ import annotations

from collections import Counter
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from arm_fleet.report.arm import link, unbroken
from arm_fleet.report.text import tasks, verdict
from arm_report import Chart, Panel, Report, Series, table
from arm_report.palette import AFTER, MEASURED
from comparison.trend import State

if TYPE_CHECKING:
    from arm_fleet.fleet import Fleet
    from arm_fleet.judging.verdicts import Verdict

MOST_NIGHTS = 60
"""Number of the latest nights that the map of nights shows."""
MOST_ARMS = 400
"""Maximum number of arms in the map of nights and in the table of all arms; fleet.json has all."""
MOST_FAILED = 1000
"""Maximum number of listed tasks without a result; tasks.parquet has all."""
MARKS = {"named": "●", "compared": "·", "failed": "×", "reference": "○"}
"""Marks of an arm and night in the map; a mark links to the report, if there is one."""


def fleet_page(fleet: Fleet) -> Report:
    """The whole fleet."""
    changed = fleet.changed
    limits = [(one.arm, its) for one in fleet.verdicts for its in one.limits]
    failed = [[one.arm, one.night or "baseline", one.state, one.reason] for one in fleet.failed[:MOST_FAILED]]
    return Report(
        title=f"{fleet.plan.name}: which arms changed",
        template="arm_fleet.report/fleet.html",
        content={
            "what": tasks(fleet),
            "says": verdict(fleet),
            "refuted": bool(changed),
            "notes": list(fleet.notes),
            "changed": _changed(fleet, changed) if changed else None,
            "actions": [(link(one.page, one.arm), one.actions) for one in fleet.verdicts if one.actions],
            "returned": [
                Markup("{}: {}, named {} to {}").format(link(one.page, one.arm), one.cause, one.since, one.until)
                for one in fleet.returned
            ],
            "limits": [(arm, its.sentence) for arm, its in limits if its.alarming],
            "not_reached": sum(its.stand is State.NOT_REACHED for _, its in limits),
            "chart": _named_per_night(fleet),
            "nights": _map(fleet),
            "marks": MARKS,
            "failed": failed,
            "left_out": max(0, len(fleet.verdicts) - MOST_ARMS),
        },
    )


def _changed(fleet: Fleet, changed: list[Verdict]) -> Markup:
    by_key = {one.key: one for one in fleet.tasks}
    rows = []
    for one in changed:
        rows.append(
            [
                link(one.page, one.arm),
                one.cause,
                unbroken(one.since or ""),
                one.moved[0] if one.moved else "",
                f"{one.p or 0.0:.2g}",
                link(by_key[one.key].report, unbroken(by_key[one.key].night)) if one.key in by_key else "",
            ]
        )
    return table(rows, ["arm", "cause", "named since", "how fast", "p corrected", "last night"], [4])


def _named_per_night(fleet: Fleet) -> Chart | None:
    """Number of changed arms per night."""
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
    return Chart(name="named", title="number of changed arms per night", panels=(panel,))


def _map(fleet: Fleet) -> Markup:
    """Arms over their latest nights, a mark in each."""
    nights = sorted({one.night for one in fleet.tasks if one.night})[-MOST_NIGHTS:]
    shown = {one.arm for one in fleet.verdicts[:MOST_ARMS]}
    marks = {
        (one.arm, one.night): MARKS["reference" if one.done else "failed"] for one in fleet.tasks if one.arm in shown
    }
    for one in fleet.alarms:
        if one.arm in shown:
            marks[one.arm, one.night] = MARKS["named" if one.named else "compared"]
    reports = {(one.arm, one.night): one.report for one in fleet.tasks if one.arm in shown}
    rows = [
        [
            link(one.page, one.arm),
            *(link(reports.get((one.arm, night)), marks.get((one.arm, night), "")) for night in nights),
        ]
        for one in fleet.verdicts[:MOST_ARMS]
    ]
    return table(rows, ["arm", *(night[5:] for night in nights)])
