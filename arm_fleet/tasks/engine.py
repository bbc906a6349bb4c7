"""Runs tasks on Dask and stores their outcomes: tasks with a stored result do not run, lost tasks run again.

Only this process writes results, which workers send to it; workers need no common disk. If a worker
dies, Dask runs its tasks on another one. If a scheduler dies, the tasks that were running are lost; they
are submitted to the next scheduler. Stored results remain.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import repeat
from typing import TYPE_CHECKING, Any

from arm_fleet.tasks.bounded import bounded
from arm_fleet.tasks.cluster import Cluster
from arm_fleet.tasks.store import Store
from arm_fleet.tasks.task import Outcome, State, Task
from arm_fleet.tasks.version import code_version
from arm_io import InputError
from arm_io.progress import Progress, Step

if TYPE_CHECKING:
    from distributed import Client, Future

MOST_LOSSES = 20
"""Number of losses of the scheduler after which a plan is abandoned."""
KEEPERS = 4
"""Number of threads that fetch results and write them to the disk."""


class _SchedulerLost(Exception):
    """The scheduler has ended, and its running tasks are lost."""


@dataclass
class Engine:
    """Runs plans.

    notes  sentences about events of workers and scheduler
    ran    number of tasks that ran, without those whose result was stored already
    """

    store: Store
    cluster: Cluster
    progress: Progress = lambda _: None
    notes: list[str] = field(default_factory=list)
    ran: int = 0
    _refusing: set[str] = field(default_factory=set)

    def run(self, tasks: Sequence[Task]) -> None:
        """Runs the tasks that are not settled; afterwards the store has a record of every task.

        tasks  each after the task on which it depends
        InputError if results cannot be stored, or if there is no worker.
        """
        waiting = {task.key: task for task in tasks if not self.store.settled(task)}
        total = len(waiting)
        try:
            for _ in range(MOST_LOSSES):
                if not waiting:
                    break
                with self.cluster.client() as client:
                    try:
                        for address, why in _refusing(client, next(iter(waiting.values())).code).items():
                            self._refuse(address, why)
                        self._collect(client, waiting, total)
                    except _SchedulerLost:
                        self.notes.append(f"the scheduler was lost; {len(waiting)} tasks were handed to the next one")
        finally:
            self.ran = total - len(waiting)
        if waiting:
            raise InputError(
                str(self.cluster.scheduler), f"was lost {MOST_LOSSES} times; {len(waiting)} tasks are left"
            )

    def _collect(self, client: Client, waiting: dict[str, Task], total: int) -> None:
        """Submits all waiting tasks and stores their outcomes; removes each from ``waiting`` once it is stored."""
        from distributed import as_completed

        running: dict[Future, Task] = {}
        # Kept only for those that need them: Dask forgets the result of a task whose future is gone.
        needed: dict[str, Future] = {}
        keys = {task.after for task in waiting.values()}

        def submit(task: Task, anew: bool = False) -> Future:
            future = self._submit(client, task, needed, anew)
            running[future] = task
            if task.key in keys:
                needed[task.key] = future
            return future

        finished = as_completed([submit(task) for task in waiting.values()], loop=client.loop)
        # Fetching a result and bringing it to the disk wait for others, not for the processor.
        with ThreadPoolExecutor(KEEPERS) as keepers:
            for batch in finished.batches():
                tasks = [running.pop(future) for future in batch]
                outcomes = keepers.map(self._keep, batch, tasks, repeat(waiting))
                for task, outcome in zip(tasks, outcomes):
                    if outcome.state is State.REFUSED:
                        self._refuse(outcome.worker, outcome.reason)
                        finished.add(submit(task, anew=True))
                        continue
                    self.progress(Step("tasks", total - len(waiting), total, detail=task.name))

    def _keep(self, future: Future, task: Task, waiting: dict[str, Task]) -> Outcome:
        """Fetches the outcome of a task and stores it, unless a worker refused the task."""
        outcome = _outcome(future)
        if outcome.state is not State.REFUSED:
            self.store.put(task, outcome)
            del waiting[task.key]
        return outcome

    def _submit(self, client: Client, task: Task, needed: Mapping[str, Future], anew: bool) -> Future:
        """Submits a task to Dask with the outcome on which it depends, which Dask moves from worker to worker."""
        before: Any = {}
        if task.after is not None:
            before = needed.get(task.after) or self._kept(task.after)
        named: dict[str, Any] = {"key": f"{task.key}-{len(self._refusing)}" if anew else task.key}
        if self._refusing:
            named["workers"] = self._willing(client)
        return client.submit(execute, task.to_json(), before, pure=False, **named)

    def _kept(self, key: str) -> Outcome:
        record = self.store.record(key)
        if record is None:
            return Outcome(state=State.BEFORE, reason="it did not run")
        return Outcome(state=State(record["state"]), reason=record["reason"], files=self.store.files(key))

    def _refuse(self, worker: str, why: str) -> None:
        if worker not in self._refusing:
            self._refusing.add(worker)
            self.notes.append(f"worker {worker} is not used: {why}")

    def _willing(self, client: Client) -> list[str]:
        """Workers with the same code version. InputError if there is none."""
        willing = [
            address for address in client.scheduler_info(n_workers=-1)["workers"] if address not in self._refusing
        ]
        if not willing:
            raise InputError(
                str(self.cluster.scheduler),
                f"all its workers run another version of armscope than this command ({code_version()}); "
                "install the same on all",
            )
        return willing


def execute(table: Mapping[str, Any], before: Outcome | Mapping[str, Any]) -> Outcome:
    """Entry point on a worker: refuses a task of another code version, else runs it in a separate process.

    before  outcome of the task on which this one depends
    """
    task = Task(**table)
    where = _worker()
    if task.code != code_version():
        return Outcome(state=State.REFUSED, reason=_other_code(code_version(), task.code), worker=where)
    files: Mapping[str, bytes] = {}
    if isinstance(before, Outcome):
        if before.state is State.REFUSED:
            return before
        if not before.done:
            return Outcome(state=State.BEFORE, reason=f"its baseline failed: {before.reason}", worker=where)
        files = before.files
    outcome = bounded(task, files)
    return Outcome(**(vars(outcome) | {"worker": where}))


def _worker() -> str:
    from distributed import get_worker

    try:
        return str(get_worker().address)
    except ValueError:
        return platform.node()


def _refusing(client: Client, code: str) -> dict[str, str]:
    """Address -> reason, for workers with another version of armscope or without it."""
    found: Mapping[str, Any] = client.run(code_version, on_error="return")
    return {address: _other_code(version, code) for address, version in found.items() if version != code}


def _other_code(version: Any, code: str) -> str:
    return f"it runs code {version}, the plan was made with {code}"


def _outcome(future: Future) -> Outcome:
    """Outcome of a future, or the reason why it has none. Raises ``_SchedulerLost``."""
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    try:
        found: Outcome = future.result()
        return found
    except KilledWorker as error:
        return Outcome(state=State.KILLED, reason=f"{error.allowed_failures + 1} workers died while they ran it")
    except (CancelledError, CommClosedError, TimeoutError) as error:
        raise _SchedulerLost from error
