"""What is to be said of each arm: whether it changed, what, since when, how fast, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from arm_fleet.judging.alarms import Alarm, Night
from arm_fleet.judging.scatter import effect_of
from arm_fleet.plan import Plan
from arm_fleet.tasks.store import Record
from arm_fleet.tasks.task import State
from comparison.trend import Trend, limit_sentence, sentence, trend_of

FEWEST = 3
"""Results of a trend."""
FAILED = 3
"""Nights in a row without a result after which somebody should look."""
HINTS = 8
"""Quantities that are listed where a limit is of none."""
CHECKS = 2
"""Origins per cause whose check is named."""


class Condition(StrEnum):
    """Of an arm in its last night."""

    CHANGED = "changed"
    RETURNED = "changed, and is as before again"
    HEALTHY = "no change"
    UNKNOWN = "no result that can be compared"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What is said of one arm.

    since, until  first and last night of the latest uninterrupted series of named nights; None: it has none
    cause    what changed, in words: a cause that diagnoses name, else the quantity that changed most surely
    trends   of its identifications and diagnoses; empty where nothing was named and no limit is set
    moved    sentences about what moved, and limits
    actions  what to do next
    key      of the last named night, whose report shows the cause
    failed   its nights without a result: night, state, reason
    page     path of its page relative to the folder; None: it has none
    without_limit  limits of the plan whose quantity its results lack; None: they were not looked at
    quantities     some names of quantities that they have, where there is such a limit
    """

    arm: str
    condition: Condition
    nights: int
    since: str | None = None
    until: str | None = None
    cause: str = ""
    p: float | None = None
    trends: tuple[Trend, ...] = ()
    moved: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    key: str | None = None
    failed: tuple[tuple[str, str, str], ...] = field(default=())
    page: str | None = None
    without_limit: tuple[str, ...] | None = None
    quantities: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        return {
            "arm": self.arm,
            "condition": str(self.condition),
            "nights": self.nights,
            "since": self.since,
            "until": self.until,
            "cause": self.cause or None,
            "p_corrected": self.p,
            "moved": list(self.moved),
            "next": list(self.actions),
            "result": self.key,
            "failed": [dict(zip(("night", "state", "reason"), one)) for one in self.failed],
        }


def verdict_of(
    plan: Plan, arm: str, nights: Sequence[Night], alarms: Sequence[Alarm], records: Sequence[Record]
) -> Verdict:
    """Of one arm: its nights with results, its alarms by night, and the records of all its tasks."""
    failed = tuple(
        (one["night"] or "baseline", one["state"], one["reason"]) for one in records if one["state"] != State.DONE
    )
    series = _last_series(alarms)
    condition = (
        Condition.UNKNOWN
        if not alarms
        else Condition.HEALTHY
        if not series
        else Condition.CHANGED
        if series[-1] is alarms[-1]
        else Condition.RETURNED
    )
    trends = _trends(plan, nights) if series or plan.limits else []
    moved = [sentence(one, trend.histories) for trend in trends for one in trend.moved] if series else []
    moved += [limit_sentence(one, trend.histories) for trend in trends for one in trend.limited]
    by_key = {one["key"]: one for one in records}
    known = [one.moved.history.quantity.name for trend in trends for one in trend.movements]
    absent = tuple(name for name in plan.limits if name not in known)
    return Verdict(
        arm=arm,
        condition=condition,
        nights=len(nights),
        since=series[0].night if series else None,
        until=series[-1].night if series else None,
        cause=_cause(series),
        p=min((one.corrected for one in series), default=None),
        trends=tuple(trends),
        moved=tuple(moved),
        actions=tuple(_actions(condition, series, by_key, failed, trends)),
        key=series[-1].key if series else None,
        failed=failed,
        without_limit=absent if known else None,
        quantities=tuple(known[:HINTS]) if absent else (),
    )


def _last_series(alarms: Sequence[Alarm]) -> list[Alarm]:
    """The latest named nights without one between them that is not named."""
    series: list[Alarm] = []
    for one in reversed(alarms):
        if one.named:
            series.append(one)
        elif series:
            break
    return series[::-1]


def _cause(series: Sequence[Alarm]) -> str:
    """Of the latest named nights, the first that says it by a cause."""
    for alarm in reversed(series):
        named = [one.quantity for one in alarm.changes if one.quantity.kind == "cause"]
        if named:
            return named[0].words.partition(" of ")[2] or named[0].words
    return next((alarm.changes[0].quantity.words for alarm in reversed(series) if alarm.changes), "")


def _trends(plan: Plan, nights: Sequence[Night]) -> list[Trend]:
    found = []
    for kind in ("identifications", "diagnoses"):
        results = [one for night in nights for one in night.results if one.what == kind]
        if len(results) >= FEWEST:
            plain = trend_of(results)
            known = {one.moved.history.quantity.name for one in plain.movements}
            limits = [limit for limit in plan.owners_limits() if limit.name in known]
            found.append(trend_of(results, limits) if limits else plain)
    return found


def _that_changed(causes: Sequence[Mapping[str, Any]], series: Sequence[Alarm]) -> list[Mapping[str, Any]]:
    """Of the causes of a night those that changed; all where none did."""
    quantities = {(effect_of(c.quantity.name), c.quantity.joint) for one in series for c in one.changes}
    return [one for one in causes if (one["effect"], one["joint"]) in quantities] or list(causes)


def _actions(
    condition: Condition,
    series: Sequence[Alarm],
    records: Mapping[str, Record],
    failed: Sequence[tuple[str, str, str]],
    trends: Sequence[Trend],
) -> list[str]:
    """What to do next: checks of the likely origins, what reaches its limit, and recordings that fail."""
    found = []
    if condition is Condition.CHANGED:
        causes = records[series[-1].key]["value"].get("causes", []) if series[-1].key in records else []
        for cause in _that_changed(causes, series):
            found += [f"{one['title']}: {one['check']}" for one in cause.get("origins", [])[:CHECKS]]
        if not causes:
            found.append("Record the same experiments once more, with more speed, so that diagnose can name a cause")
    for trend in trends:
        found += [
            f"{limit_sentence(one, trend.histories)}: plan its maintenance before"
            for one in trend.limited
            if one.reach is not None and (one.reach.passed or one.reach.day is not None)
        ]
    if len(failed) >= FAILED:
        found.append(f"{len(failed)} nights gave no result; the last: {failed[-1][2]}")
    return list(dict.fromkeys(found))
