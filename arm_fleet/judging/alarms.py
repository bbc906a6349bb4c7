"""Detects which arms changed in which night, with the false-discovery rate controlled over the whole fleet.

Each night is compared with the reference nights of its arm, as ``armscope compare`` does (``comparison.significance``),
with the scatter between reference nights (for causes like friction: ``scatter``); friction is compared with the value
expected at the recorded temperature (``temperature``). A quantity has changed in a night if it changed in the previous
night as well, in the same direction: its p-value is the larger of both (an intersection-union test). A deviation in a
single night is therefore no change of an arm. The smallest p-value of an arm and night, times the number of quantities
(Bonferroni), is the p-value of "this arm had changed in this night". These are corrected over all arms and nights
(Benjamini and Hochberg, JRSS B 57 (1995) 289).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from arm_fleet.judging.scatter import widened
from arm_fleet.judging.temperature import no_surer, outside, regressed
from arm_fleet.plan import Plan
from arm_io.types import Array
from comparison import Change, Stored, compare_results, estimates_of

NAMEABLE = 0.05
"""Maximum p-value, times the number of quantities, of a quantity that is listed as changed."""
FEWEST_REFERENCE = 2
"""Minimum number of reference nights for a comparison."""


@dataclass(frozen=True, kw_only=True)
class Night:
    """The results of one arm and night: identification, diagnosis, or both.

    key          of its task
    temperature  mean of each joint, degC, NaN if it is not known; None: no temperature was recorded
    """

    night: str
    key: str
    results: tuple[Stored, ...]
    temperature: tuple[float, ...] | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Alarm:
    """Result of comparing one night of one arm with its reference nights.

    p, corrected  p-value of the hypothesis that the arm has not changed; the same, corrected over all arms and nights
    outside       K by which its temperature is outside the range of its reference nights
    named         whether the change is significant
    changes       quantities that changed significantly within this comparison, smallest p-value first
    """

    arm: str
    night: str
    key: str
    p: float
    corrected: float = 1.0
    outside: float = 0.0
    named: bool = False
    changes: tuple[Change, ...] = ()


def corrected(found: Sequence[Alarm], rate: float) -> list[Alarm]:
    """The same alarms with p-values corrected over all of them; ``named`` if that is at most ``rate``."""
    if not found:
        return []
    q = stats.false_discovery_control(np.array([one.p for one in found]))
    return [replace(one, corrected=float(its), named=bool(its <= rate)) for one, its in zip(found, q)]


def reference(plan: Plan, nights: Sequence[Night]) -> list[Night]:
    """The nights of an arm with which the others are compared."""
    if plan.baseline is None:
        return list(nights[: plan.reference])
    first, last = plan.baseline
    return [one for one in nights if first <= one.night <= last]


def alarms_of(plan: Plan, arm: str, nights: Sequence[Night]) -> list[Alarm]:
    """Alarms of all nights of one arm that can be compared, in the order of ``nights``; p-values not yet corrected."""
    before = reference(plan, nights)
    alarms = []
    last: dict[str, Change] = {}
    for night in nights:
        healthy = [one for one in before if one is not night]
        if len(healthy) < FEWEST_REFERENCE:
            continue
        now = {one.quantity.name: one for one in _all_changes(healthy, night)}
        if now and last and night not in before:
            p = {name: _confirmed(last.get(name), one) for name, one in now.items()}
            sure = sorted((name for name in p if len(p) * p[name] <= NAMEABLE), key=p.__getitem__)
            smallest = min(1.0, len(p) * min(p.values()))
            changes = tuple(now[name] for name in sure)
            beyond = outside(_temperature([*before, night])) if night.temperature is not None else 0.0
            alarms.append(Alarm(arm=arm, night=night.night, key=night.key, p=smallest, outside=beyond, changes=changes))
        last = now
    return alarms


def _confirmed(earlier: Change | None, later: Change) -> float:
    """p-value of a change in two successive nights in the same direction; 1 if only one shows it."""
    if earlier is None or earlier.p is None or later.p is None or not (earlier.change and later.change):
        return 1.0
    return max(earlier.p, later.p) if (earlier.change > 0) == (later.change > 0) else 1.0


def _all_changes(before: Sequence[Night], night: Night) -> list[Change]:
    """Tested quantities of one night against its reference nights."""
    found = [one for kind in ("identifications", "diagnoses") for one in _changes(kind, before, night)]
    if night.temperature is not None:
        found = no_surer(found)
    return [one for one in widened(found, len(before)) if one.p is not None]


def _changes(kind: str, before: Sequence[Night], night: Night) -> list[Change]:
    """Changes between results of one kind; none if one side has no result. Uses the temperature if it is recorded."""
    having = [(one, result) for one in (*before, night) for result in one.results if result.what == kind]
    results = [result for _, result in having]
    if len(results) < 2 or having[-1][0] is not night:
        return []
    found = compare_results(results[:-1], results[-1:]).changes
    if night.temperature is None:
        return found
    return regressed(found, *estimates_of(results), _temperature([one for one, _ in having]))


def _temperature(nights: Sequence[Night]) -> Array:
    """(nights, J) degC, NaN where it is not known; the last night has a temperature."""
    unknown = tuple(np.nan for _ in nights[-1].temperature or ())
    return np.array([one.temperature or unknown for one in nights])
