"""Verdict on each arm: whether it changed, what changed, since when, how fast, and what to do next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from arm_fleet.judging.alarms import Alarm, Night
from arm_fleet.judging.scatter import effect_of, friction_like, like_friction, of_friction
from arm_fleet.plan import Plan
from arm_fleet.tasks.store import Record
from arm_fleet.tasks.task import State
from comparison import Quantity
from comparison.trend import Movement, Trend, limit_sentence, sentence, trend_of
from comparison.trend import State as Stand

FEWEST = 3
"""Minimum number of results for a trend."""
FAILED = 3
"""Number of successive nights without a result after which a check is recommended."""
HINTS = 8
"""Maximum number of quantities that are listed if the quantity of a limit does not exist."""
CHECKS = 2
"""Number of origins per cause whose check is recommended."""


class Condition(StrEnum):
    """Condition of an arm in its last night."""

    CHANGED = "changed"
    RETURNED = "changed, and is as before again"
    HEALTHY = "no change"
    UNKNOWN = "no result that can be compared"


@dataclass(frozen=True)
class Limited:
    """State of a quantity with respect to a limit of the plan, and the sentence about it."""

    name: str
    stand: Stand
    sentence: str

    @property
    def alarming(self) -> bool:
        """Whether the limit is passed, or will be at the present drift."""
        return self.stand in (Stand.PASSED, Stand.PASSED_AT_FIRST, Stand.AHEAD)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Verdict on one arm.

    since, until  first and last night of the latest uninterrupted series of nights with a change; None: no such night
    cause    what changed, in words: the cause that changed in most nights of the series, else the quantity that changed
             most surely
    trends   of its identifications and diagnoses; empty if nothing was named and no limit is set
    moving   quantities with a trend; if temperature is recorded, friction only if a night with a change shows it
    moved    sentences about them, and limits
    limits   per limit of its quantities: name, state, sentence
    actions  what to do next
    key      of the task of the last night with a change, whose report shows the cause
    failed   its nights without a result: night, state, reason
    page     path of its page relative to the folder; None: no page
    without_limit  limits of the plan whose quantity its results lack; None: not checked
    quantities     some names of quantities that its results have, if there is such a limit
    """

    arm: str
    condition: Condition
    nights: int
    since: str | None = None
    until: str | None = None
    cause: str = ""
    p: float | None = None
    trends: tuple[Trend, ...] = ()
    moving: tuple[str, ...] = ()
    moved: tuple[str, ...] = ()
    limits: tuple[Limited, ...] = ()
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
    """Verdict on one arm from its nights with results, its alarms by night, and the records of all its tasks."""
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
    moving = _moving(trends, series, any(one.temperature is not None for one in nights))
    moved = [sentence(one, trend.histories) for one, trend in moving]
    limits = _limits(trends)
    moved += [limit.sentence for limit in limits]
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
        moving=tuple(one.moved.history.quantity.name for one, _ in moving),
        moved=tuple(moved),
        limits=tuple(limits),
        actions=tuple(_actions(condition, series, by_key, failed, limits)),
        key=series[-1].key if series else None,
        failed=failed,
        without_limit=absent if known else None,
        quantities=tuple(known[:HINTS]) if absent else (),
    )


def _last_series(alarms: Sequence[Alarm]) -> list[Alarm]:
    """The latest uninterrupted series of nights with a change."""
    series: list[Alarm] = []
    for one in reversed(alarms):
        if one.named:
            series.append(one)
        elif series:
            break
    return series[::-1]


def _cause(series: Sequence[Alarm]) -> str:
    """The cause that changed in most nights (then: smallest p-value in the last night); else a parameter."""
    latest = [one.quantity for alarm in reversed(series) for one in alarm.changes]
    words = {place_of(one): one.words.partition(" of ")[2] or one.words for one in latest if one.kind == "cause"}
    nights = _nights_of_causes(series)
    if nights:
        return words[max(nights, key=nights.__getitem__)]
    return latest[0].words if latest else ""


Place = tuple[str, int | None]
"""Effect and joint."""


def place_of(quantity: Quantity) -> Place:
    """Effect and joint of a parameter of a cause."""
    return effect_of(quantity.name), quantity.joint


def _nights_of_causes(series: Sequence[Alarm]) -> Counter[Place]:
    """Number of nights in which each cause changed; for equal numbers, smallest p-value of the latest night first."""
    counts: Counter[Place] = Counter()
    for alarm in reversed(series):
        # A cause has several parameters.
        counts.update(
            [*dict.fromkeys(place_of(change.quantity) for change in alarm.changes if change.quantity.kind == "cause")]
        )
    return counts


def _moving(trends: Sequence[Trend], series: Sequence[Alarm], heated: bool) -> list[tuple[Movement, Trend]]:
    """Quantities with a trend, those of nights with a change first; other friction may follow the temperature."""
    if not series:
        return []
    changed = {one.quantity.name for alarm in series for one in alarm.changes}
    moved = [(one, trend) for trend in trends for one in trend.moved]
    found = []
    for one, trend in moved:
        quantity = one.moved.history.quantity
        if quantity.name in changed or not (heated and friction_like(quantity)):
            found.append((one, trend))
    return sorted(found, key=lambda one: one[0].moved.history.quantity.name not in changed)


def _trends(plan: Plan, nights: Sequence[Night]) -> list[Trend]:
    trends = []
    for kind in ("identifications", "diagnoses"):
        results = [one for night in nights for one in night.results if one.what == kind]
        if len(results) >= FEWEST:
            plain = trend_of(results)
            known = {movement.moved.history.quantity.name for movement in plain.movements}
            limits = [limit for limit in plan.owners_limits() if limit.name in known]
            trends.append(trend_of(results, limits) if limits else plain)
    return trends


def _limits(trends: Sequence[Trend]) -> list[Limited]:
    return [
        Limited(one.moved.history.quantity.name, its.state, limit_sentence(one, its, trend.histories))
        for trend in trends
        for one in trend.limited
        for its in one.reaches
    ]


def _that_changed(causes: Sequence[Mapping[str, Any]], series: Sequence[Alarm]) -> list[Mapping[str, Any]]:
    """Causes of a night that changed, those of most nights first; else causes that fit the changed parameters."""
    nights = _nights_of_causes(series)
    changed = [cause for cause in causes if (cause["effect"], cause["joint"]) in nights]
    if changed:
        return sorted(changed, key=lambda one: -nights[one["effect"], one["joint"]])
    changes = [one for alarm in series for one in alarm.changes]
    joints = {change.quantity.joint for change in changes} | {None}
    friction = all(map(of_friction, changes))
    return [cause for cause in causes if cause["joint"] in joints and (like_friction(cause["effect"]) or not friction)]


def _actions(
    condition: Condition,
    series: Sequence[Alarm],
    records: Mapping[str, Record],
    failed: Sequence[tuple[str, str, str]],
    limits: Sequence[Limited],
) -> list[str]:
    """Recommended actions: checks of the likely origins, maintenance before a limit, failed recordings."""
    actions = []
    if condition is Condition.CHANGED:
        causes = records[series[-1].key]["value"].get("causes", []) if series[-1].key in records else []
        fitting = _that_changed(causes, series)
        for cause in fitting:
            actions += [f"{one['title']}: {one['check']}" for one in cause.get("origins", [])[:CHECKS]]
        if not fitting:
            actions.append("Record the same experiments again at higher speed, so that diagnose can name a cause")
    actions += [
        f"{one.sentence}: plan its maintenance {'before' if one.stand is Stand.AHEAD else 'now'}"
        for one in limits
        if one.alarming
    ]
    if len(failed) >= FAILED:
        actions.append(f"{len(failed)} nights gave no result; the last: {failed[-1][2]}")
    return list(dict.fromkeys(actions))
