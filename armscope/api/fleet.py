"""A plan of many arms and nights in; what changed in which arm, since when and how fast, out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from arm_fleet import ArmNight, ArmTasks, Cluster, Engine, Fleet, Plan, Store, Task, arm_nights, code_version, fleet_of
from arm_fleet import read_plan as _read_plan
from arm_io import read_text
from arm_io.progress import Progress, silent
from arm_model import Arm, write_model
from armscope.api.reading import File, read_model

NIGHT, BASELINE = "armscope.api.fleet_night:night", "armscope.api.fleet_night:baseline"
GIGABYTE = 10**9


def fleet(
    plan: File | Plan,
    out: File,
    *,
    scheduler: str | None = None,
    workers: int = 1,
    progress: Progress = silent,
) -> Fleet:
    """Runs a plan on Dask, judges all its results together and writes them into a folder (docs/fleet.md).

    plan       file or object: arms, recordings, what to compute
    out        folder of the results; what it holds already does not run again
    scheduler  address of a running Dask scheduler; None: ``workers`` processes of this machine
    Raises InputError where the plan is wrong, no scheduler or worker answers, or results cannot be kept. What was kept
    until then is there, and the plan goes on with the rest when it is run again.
    """
    plan = plan if isinstance(plan, Plan) else _read_plan(Path(plan))
    progress("finding recordings")
    files = {path: read_model(path) for path in {plan.model_of(arm) for arm in plan.arm}}
    models = {arm.name: files[plan.model_of(arm)] for arm in plan.arm}
    notes: list[str] = []
    tasks = tasks_of(plan, arm_nights(plan, notes.append), models)
    store = Store(Path(out))
    engine = Engine(store, Cluster(scheduler, workers), progress)
    engine.run([task for of_arm in tasks.values() for task in of_arm])
    parts = [
        ArmTasks(arm=name, model=models[name], keys=tuple(task.key for task in of_arm))
        for name, of_arm in tasks.items()
    ]
    judging = workers if scheduler is None else os.cpu_count() or 1
    notes += engine.notes
    return fleet_of(plan, store.folder, parts, workers=judging, ran=engine.ran, notes=notes, progress=progress)


def tasks_of(plan: Plan, nights: Sequence[ArmNight], models: Mapping[str, Arm]) -> dict[str, list[Task]]:
    """Arm -> a task per night, after one for its baseline where the plan adapts models to it."""
    texts: dict[int, str] = {}
    tasks: dict[str, list[Task]] = {arm.name: [] for arm in plan.arm}
    for name, group in groupby(nights, key=lambda one: one.arm.name):
        of_arm, model = list(group), models[name]
        if id(model) not in texts:
            texts[id(model)] = _text(model)
        text = texts[id(model)]
        before = _baseline(plan, of_arm, text) if plan.adapt else None
        tasks[name] = [before] if before is not None else []
        tasks[name] += [_task(plan, [one], text, before) for one in of_arm]
    return tasks


def _baseline(plan: Plan, nights: Sequence[ArmNight], model: str) -> Task:
    first, last = plan.baseline or ("", "")
    healthy = [one for one in nights if first <= one.night <= last] if plan.baseline else nights[: plan.reference]
    return _task(plan, healthy or nights[:1], model, None, baseline=True)


def _task(plan: Plan, nights: Sequence[ArmNight], model: str, before: Task | None, *, baseline: bool = False) -> Task:
    arm = nights[0].arm
    arguments: dict[str, Any] = {
        "name": arm.name,
        "model": model,
        "recordings": [content for one in nights for content in one.contents],
        "run": list(plan.run),
        "report": plan.report,
        "seconds": plan.seconds,
        "rig": arm.rig,
        "calibration": arm.calibration,
    }
    return Task(
        arm=arm.name,
        night="" if baseline else nights[0].night,
        call=BASELINE if baseline else NIGHT,
        arguments=arguments,
        places={"places": [place for one in nights for place in one.places], "storage": dict(plan.storage)},
        code=code_version(),
        after=None if before is None else before.key,
        timeout=plan.timeout,
        memory=int(plan.memory * GIGABYTE),
    )


def _text(arm: Arm) -> str:
    """A model as TOML text, so that workers need no file."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "model.toml")
        write_model(path, arm)
        return read_text(path)
