"""Which arms changed in which night, with false alarms controlled over the whole fleet.

Each night is compared with the reference nights of its arm, together with the night before it: what only one night
shows is no change of an arm. The comparison is that of ``armscope compare`` (``comparison.significance``), with the
scatter between nights. The smallest p-value of an arm and night, times the number of quantities (Bonferroni), is that
of "this arm had changed in this night"; over all arms and nights these are corrected as Benjamini and Hochberg do
(JRSS B 57 (1995) 289).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from arm_fleet.plan import Plan
from comparison import Change, Stored, compare_results

CONFIRM = 2
"""Nights that are compared together."""
FEWEST_REFERENCE = 2
"""Nights without which nothing can be compared."""


@dataclass(frozen=True, kw_only=True)
class Night:
    """The results of one arm and night: identification, diagnosis, or both; key: of its task."""

    night: str
    key: str
    results: tuple[Stored, ...]


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """What one night of one arm says.

    p, corrected  that the arm is as in its reference nights; corrected over all arms and nights
    named         whether it is called changed
    changes       quantities that changed significantly within this comparison, the surest first
    """

    arm: str
    night: str
    key: str
    p: float
    corrected: float = 1.0
    named: bool = False
    changes: tuple[Change, ...] = ()


def alarms(plan: Plan, fleet: Mapping[str, Sequence[Night]]) -> list[Alarm]:
    """Every night that can be compared, by arm and night; ``fleet``: arm -> its nights, in order."""
    found = [one for arm, nights in fleet.items() for one in _of_arm(plan, arm, nights)]
    return corrected(found, plan.rate)


def corrected(found: Sequence[Alarm], rate: float) -> list[Alarm]:
    """The same with p-values corrected over all of them; named where that is at most ``rate``."""
    if not found:
        return []
    q = stats.false_discovery_control(np.array([one.p for one in found]))
    return [replace(one, corrected=float(its), named=bool(its <= rate)) for one, its in zip(found, q)]


def reference(plan: Plan, nights: Sequence[Night]) -> list[Night]:
    """The nights of an arm that others are compared with."""
    if plan.baseline is None:
        return list(nights[: plan.reference])
    first, last = plan.baseline
    return [one for one in nights if first <= one.night <= last]


def _of_arm(plan: Plan, arm: str, nights: Sequence[Night]) -> list[Alarm]:
    before = reference(plan, nights)
    found = []
    for place, night in enumerate(nights):
        after = nights[max(0, place + 1 - CONFIRM) : place + 1]
        healthy = [one for one in before if one not in after]
        if night in before or len(healthy) < FEWEST_REFERENCE:
            continue
        changes = [one for kind in ("identifications", "diagnoses") for one in _changes(kind, healthy, after)]
        tested = [one for one in changes if one.p is not None]
        if not tested:
            continue
        p = min(1.0, len(tested) * min(one.p for one in tested if one.p is not None))
        sure = sorted((one for one in tested if one.significant), key=lambda one: one.p or 0.0)
        found.append(Alarm(arm=arm, night=night.night, key=night.key, p=p, changes=tuple(sure)))
    return found


def _changes(kind: str, before: Sequence[Night], after: Sequence[Night]) -> list[Change]:
    """Of the results of one kind; none where one side has none."""
    sides = [[one for night in side for one in night.results if one.what == kind] for side in (before, after)]
    return compare_results(*sides).changes if all(sides) else []
