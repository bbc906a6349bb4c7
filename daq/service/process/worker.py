"""A thread for what may take long (devices, files), so that commands are heard meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from arm_io import InputError

T = TypeVar("T")
MOST_WAITING = 8
"""Commands that wait for one worker at most; further ones are refused at once."""


class Worker:
    """Jobs one after the other. ``done`` is called, on that thread, after each."""

    def __init__(self, name: str, done: Callable[[], None]) -> None:
        self._name = name
        self._executor = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._done = done
        self._since: float | None = None
        self._places = threading.BoundedSemaphore(MOST_WAITING)

    def submit(self, job: Callable[[], T]) -> Future[T]:
        """Queues a job. InputError where too many wait already."""
        if not self._places.acquire(blocking=False):
            raise InputError("daemon", f"has {MOST_WAITING} commands for its {self._name} waiting; try again")

        def timed() -> T:
            self._since = time.monotonic()
            try:
                return job()
            finally:
                self._since = None
                self._places.release()

        future = self._executor.submit(timed)
        future.add_done_callback(lambda _: self._done())
        return future

    @property
    def busy_seconds(self) -> float:
        """s that the present job has taken so far; 0 where there is none."""
        since = self._since
        return 0.0 if since is None else time.monotonic() - since

    def close(self) -> None:
        """Waits for the jobs, and ends the thread."""
        self._executor.shutdown()
