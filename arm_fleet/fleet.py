"""The judged results of a plan: fleet.json, fleet.html, the tables, and a page per arm that changed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm_fleet.judging.alarms import Alarm, Night, alarms
from arm_fleet.judging.nights import nights_of
from arm_fleet.judging.verdicts import Condition, Verdict, verdict_of
from arm_fleet.plan import Plan
from arm_fleet.report.page import arm_file, arm_page, fleet_page
from arm_fleet.report.tables import write_tables
from arm_fleet.tasks.store import Record, Store
from arm_fleet.tasks.task import State
from arm_io import make_folder, write_text
from arm_io.progress import Progress, Step
from arm_model import Arm

SCHEMA = "armscope.fleet/1"


@dataclass(frozen=True, kw_only=True, repr=False)
class Fleet:
    """What ``armscope fleet`` returns; ``to_json`` has the layout of fleet.json.

    records   of all tasks of the plan that ran, now or earlier; ran: so many of them ran now
    alarms    of every night that could be compared; verdicts: of every arm, as in the plan
    """

    plan: Plan
    folder: Path
    records: list[Record]
    nights: Mapping[str, Sequence[Night]]
    alarms: list[Alarm]
    verdicts: list[Verdict]
    ran: int = 0
    notes: tuple[str, ...] = ()

    @property
    def changed(self) -> list[Verdict]:
        """Arms that are called changed in their last night, the surest first."""
        found = [one for one in self.verdicts if one.condition is Condition.CHANGED]
        return sorted(found, key=lambda one: one.p or 0.0)

    @property
    def failed(self) -> list[Record]:
        """Tasks without a result."""
        return [one for one in self.records if one["state"] != State.DONE]

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
            "changed": [one.arm for one in self.changed],
            "tasks": len(self.records),
            "ran": self.ran,
            "failed": len(self.failed),
            "compared_nights": len(self.alarms),
            "named_nights": sum(one.named for one in self.alarms),
            "false_discovery_rate": self.plan.rate,
            "notes": list(self.notes),
        }

    def write(self, progress: Progress = lambda _: None) -> dict[str, Any]:
        """Writes all but the results themselves into the folder; returns what fleet.json says."""
        named = {one.key: {"p": one.p, "p_corrected": one.corrected, "named": one.named} for one in self.alarms}
        write_tables(self.folder, self.records, named)
        shown = [one for one in self.verdicts if one.trends and one.since]
        for k, verdict in enumerate(shown):
            progress(Step("pages", k, len(shown), detail=verdict.arm))
            make_folder(self.folder / "arms")
            write_text(self.folder / arm_file(verdict.arm), arm_page(self, verdict).html())
        write_text(self.folder / "fleet.html", fleet_page(self).html())
        table = self.to_json()
        write_text(self.folder / "fleet.json", json.dumps(table, indent=1, default=float) + "\n")
        return table


def fleet_of(
    plan: Plan,
    store: Store,
    records: Sequence[Record],
    models: Mapping[str, Arm],
    *,
    ran: int = 0,
    notes: Sequence[str] = (),
    progress: Progress = lambda _: None,
) -> Fleet:
    """The results of a plan, judged together.

    models  arm -> its nominal model
    InputError where a limit is no number.
    """
    progress("comparing nights")
    nights = nights_of(store, records, models)
    found = alarms(plan, nights)
    verdicts = []
    for k, arm in enumerate(plan.arm):
        progress(Step("trends", k, len(plan.arm), detail=arm.name))
        mine = [one for one in found if one.arm == arm.name]
        own = [one for one in records if one["arm"] == arm.name]
        verdicts.append(verdict_of(plan, arm.name, nights[arm.name], mine, own))
    return Fleet(
        plan=plan,
        folder=store.folder,
        records=list(records),
        nights=nights,
        alarms=found,
        verdicts=verdicts,
        ran=ran,
        notes=tuple(notes),
    )
