"""Judges the arms of a fleet one by one: each call reads the results of one arm from the disk, and keeps a summary.

Memory therefore does not grow with the size of the results, and several processes can share the work.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from arm_fleet.judging.alarms import Alarm, alarms_of
from arm_fleet.judging.nights import nights_of
from arm_fleet.judging.verdicts import Verdict, verdict_of
from arm_fleet.plan import Plan
from arm_fleet.report.arm import arm_file, arm_page
from arm_fleet.report.tables import Tables, tables_of
from arm_fleet.tasks.store import Record, Store, TaskLine, line_of
from arm_io import make_folder, write_text
from arm_model import Arm


@dataclass(frozen=True, kw_only=True)
class ArmTasks:
    """One arm of a plan: its nominal model, and the keys of its tasks."""

    arm: str
    model: Arm
    keys: tuple[str, ...]


@dataclass(frozen=True)
class Compared:
    """Outcomes of the tasks of one arm, and alarms of the nights that could be compared, p-values not yet corrected."""

    lines: list[TaskLine]
    alarms: list[Alarm]


@dataclass(frozen=True)
class Judged:
    """The verdict on one arm, without its histories, and its rows of the tables."""

    verdict: Verdict
    tables: Tables


def compare(plan: Plan, folder: Path, part: ArmTasks) -> Compared:
    """Compares every night of an arm with its reference nights."""
    store = Store(folder)
    records = _records(store, part)
    return Compared([line_of(one) for one in records], alarms_of(plan, part.arm, nights_of(store, records, part.model)))


def judge(plan: Plan, folder: Path, part: ArmTasks, alarms: Sequence[Alarm]) -> Judged:
    """Judges an arm by its alarms, which are corrected over the whole fleet; writes its page if it changed.

    InputError where the page cannot be written.
    """
    store = Store(folder)
    records = _records(store, part)
    # Histories are read for arms of which there is something to say: most are healthy.
    notable = bool(plan.limits) or any(one.named for one in alarms)
    verdict = verdict_of(plan, part.arm, nights_of(store, records, part.model) if notable else [], alarms, records)
    verdict = replace(verdict, nights=sum(line_of(one).done and bool(one["night"]) for one in records))
    if verdict.trends and verdict.since:
        path = folder / arm_file(part.arm)
        make_folder(path.parent)
        write_text(path, arm_page(verdict, [line_of(one) for one in records], alarms).html())
        verdict = replace(verdict, page=arm_file(part.arm))
    return Judged(replace(verdict, trends=()), tables_of(records, {one.key: one for one in alarms}))


def _records(store: Store, part: ArmTasks) -> list[Record]:
    return [record for key in part.keys if (record := store.record(key)) is not None]
