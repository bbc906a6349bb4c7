"""A plan of many arms and nights in; what changed in which arm, since when and how fast, out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from arm_fleet import ArmNight, Cluster, Engine, Fleet, Plan, Store, Task, arm_nights, code_version, fleet_of
from arm_fleet import read_plan as _read_plan
from arm_io import read_text
from arm_io.progress import Progress
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
    progress: Progress = lambda _: None,
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
    models = {arm.name: read_model(plan.model_of(arm)) for arm in plan.arm}
    tasks = tasks_of(plan, arm_nights(plan), models)
    store = Store(Path(out))
    engine = Engine(store, Cluster(scheduler, workers), progress)
    records = engine.run(tasks)
    kept = [records[task.key] for task in tasks if task.key in records]
    found = fleet_of(plan, store, kept, models, ran=engine.ran, notes=engine.notes, progress=progress)
    found.write(progress)
    return found


def tasks_of(plan: Plan, nights: Sequence[ArmNight], models: dict[str, Arm]) -> list[Task]:
    """One task per arm and night, and one per arm for its baseline where the plan adapts models to it."""
    texts = {name: _text(arm) for name, arm in models.items()}
    tasks: list[Task] = []
    for arm in plan.arm:
        mine = [one for one in nights if one.arm.name == arm.name]
        before = None
        if plan.adapt:
            before = _baseline(plan, mine, texts[arm.name])
            tasks.append(before)
        tasks += [_task(plan, [one], texts[arm.name], before) for one in mine]
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
    """A model as TOML, so that workers need no file."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "model.toml")
        write_model(path, arm)
        return read_text(path)
