"""What a fleet costs: overhead per task, arm-nights per hour with 1 and 2 workers, bytes and memory.

Overhead: tasks that compute nothing, one worker. ``dask_ms`` is Dask alone (a function in the worker), ``process_ms``
the process of its own that each task has, in the same thread, ``task_ms`` all of it with the result on the disk;
``task_cpu_ms`` is the processor time of all processes together.
Arm-nights: identification and diagnosis of two recordings of 12 s of the simulated two-link arm, without reports. Rates
are those while every worker computes: of each worker from its first result to its last. ``efficiency_2`` is the rate
of two workers over twice that of one. On a machine that others use, wall times say little; ``night_cpu_s`` is
processor time of a task.
Reading: shares of the bytes of a recording of 5 minutes and of 30 minutes that a task asks for (``seconds`` = 180).
Judging: the same nights as results of many arms, per arm and night.

Run as ``python -m benchmarks.fleet [--json]``.
"""

from __future__ import annotations

import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.report import report

if TYPE_CHECKING:
    from arm_fleet import Task

# Processes of tasks import this module, as they do any main module: what takes time to import stands in functions.
EMPTY, ARMS, NIGHTS = 100, 2, 10
ROWS = 250
"""Per s of the long recordings."""
COPIES = 30
"""Arms that are judged: the same results under other names."""


def empty(number: int) -> Task:
    """The task with that number."""
    from arm_fleet import Task, code_version

    return Task(
        arm=f"a{number}",
        night="2026-01-01",
        call="benchmarks.empty_task:nothing",
        arguments={"number": number},
        code=code_version(),
        timeout=60.0,
        memory=10**9,
    )


def overhead(folder: Path) -> dict[str, float]:
    """ms per task."""
    from arm_fleet import Cluster, Engine, Store
    from arm_fleet.tasks.bounded import bounded

    with Cluster().client() as client:
        client.submit(int, 0, pure=False).result()
        began = time.perf_counter()
        client.gather([client.submit(int, k, pure=False) for k in range(EMPTY)])
        dask = time.perf_counter() - began
    bounded(empty(-1), {})
    began = time.perf_counter()
    for number in range(EMPTY):
        bounded(empty(number), {})
    process = time.perf_counter() - began
    moments: list[tuple[float, float]] = []
    engine = Engine(Store(folder), Cluster(), lambda _: moments.append((time.perf_counter(), cpu())))
    engine.run([empty(k) for k in range(EMPTY)])
    # From the first tasks that are kept on: starting the worker and the server of its processes is no part of a task.
    begun = EMPTY // 10
    task, used = ((last - first) / (EMPTY - 1 - begun) for first, last in zip(moments[begun], moments[-1]))
    milliseconds = {"dask_ms": dask / EMPTY, "process_ms": process / EMPTY, "task_ms": task, "task_cpu_ms": used}
    return {name: 1e3 * value for name, value in milliseconds.items()}


def cpu() -> float:
    """s of processor time of this process and of all below it, ended or not."""
    import psutil

    total = 0.0
    this = psutil.Process()
    for one in (this, *this.children(recursive=True)):
        with suppress(psutil.NoSuchProcess):
            times = one.cpu_times()
            total += times.user + times.system + times.children_user + times.children_system
    return total


class Counting:
    """A file system that counts what is read."""

    def __init__(self, system: object) -> None:
        self.system, self.read = system, 0

    def cat_file(self, *place: object, **span: object) -> bytes:
        data: bytes = self.system.cat_file(*place, **span)  # type: ignore[attr-defined]
        self.read += len(data)
        return data

    def __getattr__(self, name: str) -> object:
        return getattr(self.system, name)


def nights(folder: Path) -> dict[str, float]:
    """Arm-nights of a simulated fleet."""
    from arm_fleet import Scene, arm_nights, lives, read_plan, write_fleet
    from arm_fleet.recordings import file_system, identity
    from arm_model import read_model
    from armscope.shipped import found

    scene = Scene(arm=read_model(found("config/models/two_link.toml")))
    began = time.perf_counter()
    write_fleet(folder, scene, lives(ARMS, NIGHTS, worn=0.0, seed=1), NIGHTS, seed=1)
    simulated = time.perf_counter() - began
    plan = folder / "plan.toml"
    plan.write_text(plan.read_text().replace("timeout", 'report = "none"\ntimeout', 1))
    each = [place for one in arm_nights(read_plan(plan)) for place in one.places]
    counting = Counting(file_system(each[0], {})[0])
    for place in each:
        identity(counting, place)
    size = sum(Path(place).stat().st_size for place in each)
    figures = {
        "simulated_over_real_time": len(each) * scene.seconds / simulated,
        "bytes_read_to_plan_per_recording": counting.read / len(each),
        "bytes_per_recording": size / len(each),
    }
    rates: dict[int, float] = {}
    for workers in (1, 2):
        rates[workers], tasks = ran(plan, folder / f"results{workers}", workers)
        figures[f"nights_per_hour_{workers}"] = 3600 * rates[workers]
    figures["efficiency_2"] = rates[2] / (2 * rates[1])
    figures["night_cpu_s"] = sum(tasks["cpu_seconds"]) / len(tasks["cpu_seconds"])
    figures["night_peak_mb"] = max(tasks["peak_bytes"]) / 1e6
    results = folder / "results2/results"
    figures["result_kb"] = sum(file.stat().st_size for file in results.rglob("*")) / len(tasks["key"]) / 1e3
    return figures


def ran(plan: Path, out: Path, workers: int) -> tuple[float, dict[str, list]]:
    """Arm-nights per s of all workers while they compute, and the table of tasks."""
    from pyarrow import parquet

    import armscope

    moments: dict[str, float] = {}

    def progress(sentence: str) -> None:
        if getattr(sentence, "stage", "") == "tasks":
            moments[sentence.removeprefix("tasks: ")] = time.perf_counter()

    armscope.fleet(plan, out, workers=workers, progress=progress)
    tasks = parquet.read_table(out / "tasks.parquet").to_pydict()
    ended: dict[str, list[float]] = {}
    for arm, night, worker in zip(tasks["arm"], tasks["night"], tasks["worker"]):
        ended.setdefault(worker, []).append(moments[f"{arm} of {night}"])
    return sum((len(its) - 1) / (max(its) - min(its)) for its in ended.values() if len(its) > 1), tasks


def reading(folder: Path) -> dict[str, float]:
    """Share of the bytes of long recordings that a task asks for."""
    import numpy as np

    from arm_fleet import fetched
    from daq.recording import Attachments, write_table

    figures = {}
    for minutes in (5, 30):
        t = np.arange(60 * minutes * ROWS) / ROWS
        q = np.sin(np.outer(t, [1.0, 2.0])) + 1e-3 * np.random.default_rng(1).normal(size=(len(t), 2))
        path = folder / f"{minutes}.mcap"
        write_table(path, t, {"q": q, "i": q, "qref": q}, Attachments())
        found = fetched([str(path)], folder / str(minutes), {}, 180.0)
        figures[f"bytes_read_share_{minutes}_min"] = found.read / found.size
    return figures


def judging(folder: Path) -> dict[str, float]:
    """ms of processor time and kB of memory per arm and night."""
    import json
    import shutil
    import tracemalloc

    from arm_fleet import ArmTasks, fleet_of, read_plan
    from arm_fleet.tasks.store import RECORD
    from arm_model import read_model

    plan, arm = read_plan(folder / "plan.toml"), read_model(folder / "model.toml")
    records = [json.loads(path.read_text()) for path in (folder / "results2/results").glob(f"*/{RECORD}")]
    parts, out = [], folder / "judged"
    for copy in range(COPIES):
        keys = []
        for record in (one for one in records if one["arm"] == records[0]["arm"]):
            key = f"{copy}-{record['key']}"
            shutil.copytree(folder / "results2/results" / record["key"], out / "results" / key)
            text = json.dumps(record | {"arm": f"arm-{copy}", "key": key})
            (out / "results" / key / RECORD).write_text(text)
            keys.append(key)
        parts.append(ArmTasks(arm=f"arm-{copy}", model=arm, keys=tuple(keys)))
    count = sum(len(one.keys) for one in parts)
    plan = plan.model_copy(update={"arm": tuple(plan.arm[0].model_copy(update={"name": one.arm}) for one in parts)})
    began = time.process_time()
    fleet_of(plan, out, parts)
    used = time.process_time() - began
    tracemalloc.start()
    fleet = fleet_of(plan, out, parts)
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(fleet.tasks) == count
    return {"judging_ms": 1e3 * used / count, "judged_kb": held / count / 1e3, "judging_peak_mb": peak / 1e6}


def main() -> None:
    """Measures and prints."""
    with tempfile.TemporaryDirectory() as folder:
        fleet = Path(folder, "fleet")
        figures = overhead(Path(folder, "empty")) | nights(fleet) | reading(fleet) | judging(fleet)
    report(figures)


if __name__ == "__main__":
    main()
