"""The state of a fleet in sentences and as a table of text."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from arm_fleet.judging.verdicts import Condition
from arm_report import text_table

if TYPE_CHECKING:
    from arm_fleet.fleet import Fleet

HEADS = ("arm", "changed since", "cause", "p corr.")
MOST_FAILED = 5
"""Maximum number of failed tasks whose reason is printed; tasks.parquet has all."""


def verdict(fleet: Fleet) -> str:
    """Verdict on the fleet in one sentence."""
    nights, named = len(fleet.alarms), sum(one.named for one in fleet.alarms)
    share = f"at most {fleet.plan.rate:.1%} of them are expected to differ by chance"
    if not fleet.alarms:
        return "No night could be compared with reference nights of its arm."
    changed, arms = len(fleet.changed), len(fleet.verdicts)
    returned = len(fleet.returned)
    again = (
        f" {returned} had changed, and {'agrees' if returned == 1 else 'agree'} with the reference nights again."
        if returned
        else ""
    )
    unknown = sum(one.condition is Condition.UNKNOWN for one in fleet.verdicts)
    without = f" {unknown} cannot be compared." if unknown else ""
    return (
        f"{changed} of {arms} arms {'is' if changed == 1 else 'are'} changed.{again}{without} "
        f"{named} of {nights} nights of single arms differ from the reference nights of their arm ({share})."
    )


def tasks(fleet: Fleet) -> str:
    """'120 tasks: 118 done, 2 timeout; 40 computed now'."""
    states = Counter(one.state for one in fleet.tasks)
    words = ", ".join(f"{count} {state}" for state, count in states.most_common())
    return f"{len(fleet.tasks)} tasks: {words or 'none'}; {fleet.ran} computed now"


def text(fleet: Fleet) -> str:
    """A table of arms that changed, sentences about each, what failed, and the verdict."""
    rows = [(one.arm, one.since or "", one.cause, f"{one.p or 0.0:.2g}") for one in fleet.changed]
    lines = text_table(rows, HEADS, numbers=(3,), shorten=(2,), keep=(0, 1)) if rows else []
    for one in fleet.changed:
        lines += [f"{one.arm}: {sentence}" for sentence in one.moved[:2]]
        lines += [f"{one.arm}: next: {action}" for action in one.actions[:2]]
    lines += [f"{one.arm}: {one.condition} (named {one.since} to {one.until}: {one.cause})" for one in fleet.returned]
    lines += [
        f"no result: {one.arm} {one.night or 'baseline'}: {one.state}: {one.reason}"
        for one in fleet.failed[:MOST_FAILED]
    ]
    if len(fleet.failed) > MOST_FAILED:
        lines.append(f"no result: {len(fleet.failed) - MOST_FAILED} more; tasks.parquet has all")
    lines += [f"note: {note}" for note in fleet.notes]
    return "\n".join([*lines, tasks(fleet), verdict(fleet)])
