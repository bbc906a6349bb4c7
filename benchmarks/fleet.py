"""What a fleet costs: overhead per task, arm-nights per hour with 1 and 2 workers, bytes and memory.

Overhead: tasks that compute nothing, one worker. ``dask_ms`` is Dask alone (a function in the worker), ``process_ms``
the process of its own that each task has, in the same thread, ``task_ms`` all of it with the result on the disk.
Arm-nights: identification and diagnosis of two recordings of 12 s of the simulated two-link arm, without reports;
``efficiency_2`` is time with one worker over twice the time with two. On a machine that others use, wall times say
little; ``night_cpu_s`` is processor time of a task.

Run as ``python -m benchmarks.fleet [--json]``.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.report import report

if TYPE_CHECKING:
    from arm_fleet import Task

# Processes of tasks import this module, as they do any main module: what takes time to import stands in functions.
EMPTY, ARMS, NIGHTS = 60, 2, 6


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
    moments: list[float] = []
    Engine(Store(folder), Cluster(), lambda _: moments.append(time.perf_counter())).run(
        [empty(k) for k in range(EMPTY)]
    )
    # From the first task that is kept on: starting the worker and the server of its processes is no part of a task.
    task = (moments[-1] - moments[0]) / (EMPTY - 1)
    return {"dask_ms": 1e3 * dask / EMPTY, "process_ms": 1e3 * process / EMPTY, "task_ms": 1e3 * task}


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
    walls, records = {}, []
    for workers in (1, 2):
        walls[workers], records = ran(plan, folder / f"results{workers}", workers)
        figures[f"nights_per_hour_{workers}"] = 3600 / walls[workers]
    figures["efficiency_2"] = walls[1] / (2 * walls[2])
    figures["night_cpu_s"] = sum(one["cpu_seconds"] for one in records) / len(records)
    figures["night_peak_mb"] = max(one["peak_bytes"] for one in records) / 1e6
    figures["result_kb"] = sum(sum(one["files"].values()) for one in records) / len(records) / 1e3
    return figures


def ran(plan: Path, out: Path, workers: int) -> tuple[float, list[dict]]:
    """s of wall time per arm-night once all workers have begun, and the records."""
    import armscope

    moments: list[float] = []

    def progress(sentence: str) -> None:
        if getattr(sentence, "stage", "") == "tasks":
            moments.append(time.perf_counter())

    result = armscope.fleet(plan, out, workers=workers, progress=progress)
    return (moments[-1] - moments[workers - 1]) / (len(moments) - workers), result.records


def main() -> None:
    """Measures and prints."""
    with tempfile.TemporaryDirectory() as folder:
        figures = overhead(Path(folder, "empty")) | nights(Path(folder, "fleet"))
    report(figures)


if __name__ == "__main__":
    main()
