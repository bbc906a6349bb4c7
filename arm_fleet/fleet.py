"""The judged results of a plan: fleet.json, fleet.html, the tables, and a page per arm that changed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm_fleet.judging.alarms import Alarm, corrected
from arm_fleet.judging.missing import missing
from arm_fleet.judging.verdicts import Condition, Verdict
from arm_fleet.parts import ArmTasks, compare, judge
from arm_fleet.plan import Plan
from arm_fleet.report.page import fleet_page
from arm_fleet.report.tables import tables_in
from arm_fleet.tasks.cluster import Cluster
from arm_fleet.tasks.store import TaskLine
from arm_io import write_text
from arm_io.json_text import write_json
from arm_io.progress import Progress, Step

SCHEMA = "armscope.fleet/1"
MANY = 4000
"""Number of tasks from which several processes judge; with fewer, starting processes would take longer."""
TOGETHER = 20
"""Number of arms that are judged in one call of a process."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Fleet:
    """What ``armscope fleet`` returns; ``to_json`` has the layout of fleet.json.

    tasks     all tasks of the plan that ran, now or earlier; ran: number of those that ran now
    alarms    one per night that could be compared; verdicts: one per arm, in the order of the plan
    """

    plan: Plan
    folder: Path
    tasks: list[TaskLine]
    alarms: list[Alarm]
    verdicts: list[Verdict]
    ran: int = 0
    notes: tuple[str, ...] = ()

    @property
    def changed(self) -> list[Verdict]:
        """Arms whose last night differs significantly from their reference nights, smallest p-value first."""
        found = [one for one in self.verdicts if one.condition is Condition.CHANGED]
        return sorted(found, key=lambda one: one.p or 0.0)

    @property
    def returned(self) -> list[Verdict]:
        """Arms that had changed but agree with their reference nights in the last night, in the order of the plan."""
        return [one for one in self.verdicts if one.condition is Condition.RETURNED]

    @property
    def failed(self) -> list[TaskLine]:
        """Tasks without a result."""
        return [one for one in self.tasks if not one.done]

    def __repr__(self) -> str:
        return f"<Fleet {self.plan.name}: {len(self.changed)} of {len(self.verdicts)} arms changed>"

    def __str__(self) -> str:
        from arm_fleet.report.text import text

        return text(self)

    def to_json(self) -> dict[str, Any]:
        """The content of fleet.json."""
        return {
            "schema": SCHEMA,
            "name": self.plan.name,
            "arms": [one.to_json() for one in self.verdicts],
            "changed": [change.arm for change in self.changed],
            "returned": [one.arm for one in self.returned],
            "tasks": len(self.tasks),
            "ran": self.ran,
            "failed": len(self.failed),
            "compared_nights": len(self.alarms),
            "named_nights": sum(one.named for one in self.alarms),
            "false_discovery_rate": self.plan.rate,
            "notes": list(self.notes),
        }


def fleet_of(
    plan: Plan,
    folder: Path,
    parts: Sequence[ArmTasks],
    *,
    workers: int = 1,
    ran: int = 0,
    notes: Sequence[str] = (),
    progress: Progress = lambda _: None,
) -> Fleet:
    """Judges all stored results of a plan together, and writes pages and tables into the folder.

    parts    the arms in the order of the plan; workers: processes of this machine that judge a large fleet
    InputError where something cannot be written.
    """
    count = len(parts)
    with _mapping(workers if sum(len(one.keys) for one in parts) >= MANY else 1) as mapped:
        compared = []
        for k, one in enumerate(mapped(compare, [(plan, folder, part) for part in parts])):
            progress(Step("comparing nights", k + 1, count))
            compared.append(one)
        alarms = iter(corrected([alarm for one in compared for alarm in one.alarms], plan.rate))
        alarms_of = [[next(alarms) for _ in one.alarms] for one in compared]
        verdicts = []
        with tables_in(folder) as append:
            for k, judged in enumerate(mapped(judge, [(plan, folder, *one) for one in zip(parts, alarms_of)])):
                progress(Step("trends", k + 1, count, detail=judged.verdict.arm))
                append(judged.tables)
                verdicts.append(judged.verdict)
    lines = [line for one in compared for line in one.lines]
    judged_nights = [alarm for of_one in alarms_of for alarm in of_one]
    fleet = Fleet(
        plan=plan,
        folder=folder,
        tasks=lines,
        alarms=judged_nights,
        verdicts=verdicts,
        ran=ran,
        notes=(*notes, *missing(plan, verdicts, lines, judged_nights)),
    )
    write_text(folder / "fleet.html", fleet_page(fleet).html())
    write_json(folder / "fleet.json", fleet.to_json(), indent=1)
    return fleet


Mapped = Callable[[Callable[..., Any], Sequence[tuple[Any, ...]]], Iterable[Any]]
"""Function and arguments of each call -> results in their order."""


@contextmanager
def _mapping(workers: int) -> Iterator[Mapped]:
    """A map that calls in this process, or in ``workers`` other processes of this machine, which has the results."""
    if workers == 1:
        yield lambda function, calls: (function(*one) for one in calls)
        return
    with Cluster(workers=workers).client() as client:

        def mapped(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
            groups = [calls[k : k + TOGETHER] for k in range(0, len(calls), TOGETHER)]
            futures = [client.submit(_all, function, group, pure=False) for group in groups][::-1]
            while futures:
                # Popped, so that Dask forgets what has been read.
                yield from futures.pop().result()

        yield mapped


def _all(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]]) -> list[Any]:
    return [function(*one) for one in calls]
