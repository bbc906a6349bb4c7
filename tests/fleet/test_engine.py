"""Plans on a scheduler and workers that are processes of their own, killed while they work."""

from __future__ import annotations

import json
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

import pytest

from arm_fleet import Cluster, Engine, Store
from arm_fleet.tasks import engine
from arm_fleet.tasks.task import Task
from arm_io import InputError
from armscope.cli import run
from tests.executors import executor
from tests.fleet.calls import task
from tests.fleet.processes import OTHER_CODE, Processes, kill_worker, wait_for

pytestmark = [pytest.mark.xdist_group("fleet"), pytest.mark.timeout(400)]


@pytest.fixture
def dask(tmp_path: Path) -> Iterator[Processes]:
    """A scheduler with one worker."""
    processes = Processes(tmp_path)
    processes.start_scheduler()
    processes.start_worker()
    yield processes
    processes.stop()


def many(count: int, log: Path, **arguments: object) -> list[Task]:
    return [task(f"arm-{k}", x=k, log=str(log), **arguments) for k in range(count)]  # type: ignore[arg-type]


def results(one: Engine, plan: Sequence[Task]) -> dict[str, Any]:
    """Runs a plan; key -> what came of each task."""
    one.run(plan)
    return {task.key: one.store.record(task.key) for task in plan}


def ran(log: Path) -> Counter[str]:
    """How often each task ran."""
    return Counter(log.read_text().splitlines())


def test_a_plan_goes_on_where_it_was_interrupted(dask: Processes, tmp_path: Path) -> None:
    """Failures stop nothing; a second run computes what is new, a third nothing."""
    log, store, cluster = tmp_path / "log", Store(tmp_path / "out"), Cluster(dask.address)
    baseline = task("arm-1", x=10, night="", log=str(log))
    after = task("arm-1", x=2, after=baseline.key)
    plan = [*many(4, log), baseline, after, task("bad", "unusable"), task("ended", "suicidal")]
    plan.append(task("late", "endless", timeout=0.3))
    plan.append(task("needing", after=task("bad", "unusable").key))

    def kept_now() -> list[Path]:
        return [path for path in store.results.iterdir() if path.suffix != ".part"]

    def interrupt(_: str) -> None:
        if len(kept_now()) >= 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Engine(store, cluster, interrupt).run(plan)
    kept = len(list(store.results.iterdir()))
    assert kept == len(kept_now()) < len(plan)
    missing = [one for one in plan if not store.settled(one)]
    first = Engine(store, cluster)
    records = results(first, plan)
    assert first.ran == len(missing) >= len(plan) - kept
    assert records[after.key]["value"] == {"square": 104}
    states = Counter(record["state"] for record in records.values())
    assert states == {"done": 6, "unusable input": 1, "killed": 1, "timeout": 1, "needs a failed task": 1}
    assert records[plan[6].key]["reason"] == "a.mcap: is damaged; record it again"
    second = Engine(store, cluster)
    second.run([*plan[:6], task("new", x=7)])
    assert second.ran == 1
    finished = ran(log)
    # Tasks that ran when the plan was interrupted may have run twice; their result is there once.
    assert set(finished) == {f"arm-{k}" for k in range(4)} and len(list(store.results.iterdir())) == len(plan) + 1


@pytest.mark.slow
def test_killed_workers_lose_nothing(dask: Processes, tmp_path: Path) -> None:
    log, store = tmp_path / "log", Store(tmp_path / "out")
    dask.start_worker()
    plan = many(24, log, seconds=0.3)

    def killing() -> None:
        for k in range(3):
            wait_for(log, 4 * (k + 1))
            kill_worker(dask.workers[k % 2])

    killer = threading.Thread(target=killing)
    killer.start()
    records = results(Engine(store, Cluster(dask.address)), plan)
    killer.join()
    assert [records[one.key]["value"]["square"] for one in plan] == [k**2 for k in range(24)]
    assert len(list(store.results.iterdir())) == 24
    assert sum(ran(log).values()) >= 24


@pytest.mark.slow
def test_a_scheduler_that_is_restarted(dask: Processes, tmp_path: Path) -> None:
    """Results that were kept are not computed again; the others are handed to the new scheduler."""
    log, store = tmp_path / "log", Store(tmp_path / "out")
    plan = many(12, log, seconds=0.2)

    def restarting() -> None:
        wait_for(log, 6)
        dask.kill_scheduler()
        dask.start_scheduler()
        dask.start_worker()

    restarter = threading.Thread(target=restarting)
    restarter.start()
    one = Engine(store, Cluster(dask.address, patience=120.0))
    records = results(one, plan)
    restarter.join()
    assert [records[task.key]["value"]["square"] for task in plan] == [k**2 for k in range(12)]
    assert one.notes and all("the scheduler was lost" in note for note in one.notes)
    twice = {name for name, times in ran(log).items() if times > 1}
    assert one.ran == 12 and len(twice) <= 4, "of those that the old scheduler had, only a few were not handed over yet"


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_a_worker_with_other_code_is_refused(
    dask: Processes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    """Whether it is seen when the plan begins, or refuses a task later."""
    other = dask.start_worker(preload=OTHER_CODE)
    if not known:
        monkeypatch.setattr(engine, "_refusing", lambda *_: {})
    cluster = Cluster(dask.address)
    with cluster.client() as client:
        client.wait_for_workers(2, timeout=120)
    one = Engine(Store(tmp_path / "out"), cluster)
    records = results(one, many(8, tmp_path / "log", seconds=0.05))
    assert {record["state"] for record in records.values()} == {"done"}
    assert len({record["worker"] for record in records.values()}) == 1
    assert len(one.notes) == 1 and "is not used: it runs code 0123456789abcdef" in one.notes[0]
    dask.workers.remove(other)
    for worker in dask.workers:
        worker.terminate()
        worker.wait()
    dask.workers[:] = [other]
    with pytest.raises(InputError, match="all its workers run another version of armscope"):
        Engine(Store(tmp_path / "again"), cluster).run(many(1, tmp_path / "log"))


def test_no_scheduler(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no scheduler answers"):
        Engine(Store(tmp_path), Cluster("tcp://127.0.0.1:1", patience=0.5)).run([task("a")])
    with pytest.raises(InputError, match=r"is no address of a scheduler.*must be tcp://HOST:PORT"):
        Engine(Store(tmp_path), Cluster("nonsense://x", patience=0.5)).run([task("a")])
    assert not list(tmp_path.iterdir()), "nothing half-written stays"


@pytest.mark.slow
def test_suites_run_on_a_scheduler(dask: Processes) -> None:
    """The executor of ``tests.blind --scheduler`` and the others."""
    with executor(None, dask.address) as pool:
        running = [pool.submit(pow, k, 2) for k in range(8)]
        assert sorted(one.result() for one in as_completed(running)) == [k**2 for k in range(8)]


def test_a_night_without_result_shows_in_the_exit_status(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A nightly job must notice; its page and tables are there nevertheless."""
    (tmp_path / "2026-01-01").mkdir()
    (tmp_path / "2026-01-01/a.mcap").write_bytes(b"no recording")
    model = (root / "config/models/two_link.toml").as_posix()
    (tmp_path / "plan.toml").write_text(
        f'name = "one"\nmodel = "{model}"\nrecordings = "{{night}}/{{arm}}.mcap"\nrun = ["diagnose"]\n'
        '[[arm]]\nname = "a"\n[[arm]]\nname = "b"\n'
    )
    assert run(["fleet", str(tmp_path / "plan.toml"), "--out", str(tmp_path / "out"), "--json"]) == 4
    assert json.loads(capsys.readouterr().out)["failed"] == 1
    assert (tmp_path / "out/fleet.html").is_file()
    assert run(["fleet", str(tmp_path / "plan.toml"), "--out", str(tmp_path / "out")]) == 4
    printed = capsys.readouterr()
    assert (printed.out + printed.err).count("has no recording of arm 'b'") == 1, "said once"
