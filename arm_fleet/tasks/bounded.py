"""Runs one call in a separate process, with strict limits of time and memory.

Dask's own limits do not suffice: its nanny ends the whole worker with the other tasks on it, retries a task that needs
too much memory four times, and has no time limit (docs/decisions/0036-fleet-on-dask.md). The process is forked from a
server that has imported what tasks need, which takes 10 ms instead of 3 s for a new interpreter. The kernel refuses
memory beyond the limit. The process is killed at the end of its time, and ends when the worker that waits for it is
killed.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from arm_fleet.storage import StorageError
from arm_fleet.tasks.task import Outcome, State, Task
from arm_io import DeviceFault, InputError
from arm_io.parallel import CORES

END = 5.0
"""s, maximum time between the end of a process and its disappearance."""


def bounded(task: Task, before: Mapping[str, bytes]) -> Outcome:
    """Runs a task in a process; the outcome states what happened, whatever the task does.

    before  files of the task on which this one depends
    """
    began = time.monotonic()
    with TemporaryDirectory(prefix="armscope-fleet-") as folder:
        context = _context(task.call.partition(":")[0])
        here, there = context.Pipe(duplex=False)
        process = context.Process(  # type: ignore[attr-defined]
            target=_called, args=(there, task, folder, dict(before)), name=task.key, daemon=True
        )
        _may_have_children()
        process.start()
        there.close()
        state, reason, value, cpu, peak = _awaited(here, process, task)
        files = _files(Path(folder)) if state is State.DONE else {}
    seconds = time.monotonic() - began
    return Outcome(state=state, reason=reason, value=value, files=files, seconds=seconds, cpu=cpu, peak=peak)


Answer = tuple[State, str, dict[str, Any], float, int]
"""State, reason, value, s of processor time, maximum bytes of memory."""


def _awaited(here: Connection, process: BaseProcess, task: Task) -> Answer:
    """Answer of the process, or the reason why there is none; the process has ended afterwards."""
    try:
        if not here.poll(task.timeout):
            return State.TIME, f"took longer than {task.timeout:g} s (timeout of the plan)", {}, 0.0, 0
        answer: Answer = here.recv()
        return answer
    except (EOFError, OSError):
        process.join(END)
        return State.KILLED, f"its process ended {_how(process.exitcode)}", {}, 0.0, 0
    finally:
        process.kill()
        process.join(END)
        process.close() if process.exitcode is not None else None
        here.close()


def _how(code: int | None) -> str:
    if code is None or code >= 0:
        return f"with status {code}"
    try:
        return f"by {signal.Signals(-code).name}"
    except ValueError:
        return f"by signal {-code}"


def _files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


@cache
def _context(module: str) -> BaseContext:
    """Context that forks from a server that has imported ``module``; without fork, one that starts an interpreter."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, module])
    return context


def _may_have_children() -> None:
    """Allows a worker under Dask's nanny to start processes.

    Python forbids a daemonic process to start others, which could outlive it. These watch the worker and end with it.
    """
    multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]


def _called(there: Connection, task: Task, folder: str, before: dict[str, bytes]) -> None:
    """Entry point of the process."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # there are as many tasks as cores
    os.environ[CORES] = "1"
    module, _, name = task.call.partition(":")
    try:
        function = getattr(import_module(module), name)
        _limit_memory(task.memory)
        state, reason, value = State.DONE, "", function(task.arguments | task.places, Path(folder), before)
    except StorageError as error:
        state, reason, value = State.STORAGE, str(error), {}
    except InputError as error:
        state, reason, value = State.INPUT, str(error), {}
    except DeviceFault as error:
        state, reason, value = State.BUG, str(error), {}
    except MemoryError:
        state, reason, value = State.MEMORY, f"needs more than {task.memory / 1e9:.3g} GB (memory of the plan)", {}
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        state, reason, value = State.BUG, f"{type(error).__name__} at {where}: {error}", {}
    _unlimited()
    there.send((state, reason, value, time.process_time(), _peak()))


def _end_with_parent() -> None:
    """Ends this process when its worker is killed; other workers then run its task."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _limit_memory(size: int) -> None:
    """Limits the data of the process: all allocated memory, but not memory mapped from files."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (size, resource.getrlimit(resource.RLIMIT_DATA)[1]))


def _unlimited() -> None:
    """Removes the limit of memory, so that the answer can be sent."""
    if sys.platform != "win32":
        import resource

        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        resource.setrlimit(resource.RLIMIT_DATA, (hard, hard))


def _peak() -> int:
    if sys.platform == "win32":
        return 0
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used if sys.platform == "darwin" else 1024 * used
