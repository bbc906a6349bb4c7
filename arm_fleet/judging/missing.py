"""Sentences about missing data of a fleet: reference nights, recent recordings, the quantities of limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date

from arm_fleet.judging.alarms import FEWEST_REFERENCE, Alarm
from arm_fleet.judging.verdicts import Condition, Verdict
from arm_fleet.plan import Plan
from arm_fleet.tasks.store import TaskLine
from comparison.trend import State

SILENT = 3
"""Days without a recording of an arm, while others record, after which it is reported."""
FAR = 3.0
"""K outside the temperatures of an arm's reference nights beyond which it is reported."""
MOST_NAMES = 5
"""Maximum number of arms that a sentence names; fleet.json has all."""


def missing(plan: Plan, verdicts: Sequence[Verdict], tasks: Sequence[TaskLine], alarms: Sequence[Alarm]) -> list[str]:
    """Sentences for the top of the page; ``alarms`` of each arm by night."""
    return [*_reference(plan, verdicts), *_silent(tasks), *_warmer(alarms), *_limits(plan, verdicts)]


def _reference(plan: Plan, verdicts: Sequence[Verdict]) -> Iterator[str]:
    alone = [one.arm for one in verdicts if one.condition is Condition.UNKNOWN and one.nights]
    if not alone:
        return
    place = (
        f"the first {plan.reference} nights, which are its reference"
        if plan.baseline is None
        else f"the baseline {plan.baseline[0]} to {plan.baseline[1]}"
    )
    need = f"needs results of at least {FEWEST_REFERENCE} nights of {place}, and of two later ones"
    yield f"{_names(alone)} cannot be compared: that {need}"


def _silent(tasks: Sequence[TaskLine]) -> Iterator[str]:
    last: dict[str, str] = {}
    for one in tasks:
        last[one.arm] = max(last.get(one.arm, ""), one.night)
    latest = max(last.values(), default="")
    if not latest:
        return
    days = {arm: (date.fromisoformat(latest) - date.fromisoformat(night)).days for arm, night in last.items() if night}
    silent = [f"{arm} (since {last[arm]})" for arm, behind in days.items() if behind >= SILENT]
    if silent:
        yield f"no recording, although the latest of the fleet is of {latest}: {_names(silent)}"


def _warmer(alarms: Sequence[Alarm]) -> Iterator[str]:
    """Arms whose last night has a temperature far from those of their reference nights."""
    last = {one.arm: one.outside for one in alarms}
    far = [f"{arm} ({beyond:.0f} K in the last night)" for arm, beyond in last.items() if beyond >= FAR]
    if far:
        yield (
            f"temperature outside that of the reference nights: {_names(far)}; changes of friction that it may explain "
            "are not reported. A baseline with nights of such temperatures detects smaller changes of friction"
        )


def _limits(plan: Plan, verdicts: Sequence[Verdict]) -> Iterator[str]:
    """Limits that cannot be used: no arm has the quantity, upper or lower is ambiguous, or a percentage of zero."""
    judged = [one for one in verdicts if one.without_limit is not None]
    for name in judged[0].without_limit or () if judged else ():
        if all(name in (one.without_limit or ()) for one in judged):
            hint = next((one.quantities for one in judged if one.quantities), ())
            yield f"limits: {name} is no quantity of any arm; there are {', '.join(hint)}"
    for name, given in plan.limits.items():
        unclear, zero = (_arms(verdicts, name, stand) for stand in (State.UNCLEAR, State.NO_SHARE))
        if unclear:
            yield (
                f"limits: {name} = {given} is not above the first value of {unclear}: write '..{given}' if it is an "
                f"upper limit, '{given}..' if it is a lower one"
            )
        if zero:
            yield (
                f"limits: {name} = {given}: the first value of {zero} does not differ from zero; give an absolute limit"
            )


def _arms(verdicts: Sequence[Verdict], name: str, stand: State) -> str:
    """Names of the arms in which the limit of a quantity has this state."""
    return _names([one.arm for one in verdicts if any(its.name == name and its.stand is stand for its in one.limits)])


def _names(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMES
    return ", ".join(names[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
