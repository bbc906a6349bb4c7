"""Independent work on all cores, with the results of one: forked processes know what their parent knows.

A fork shares the parent's memory until either writes, so that arguments cost nothing; only results are sent back, on
Linux their arrays through memory that the parent maps instead of copying. Which process does what depends on who is
free; what comes back is in the order of the items, and equal to the last bit.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NoReturn, TypeVar

T = TypeVar("T")
R = TypeVar("R")

CORES = "ARMSCOPE_CORES"
"""Environment: the most cores that a command uses; by default all that it may use."""
_NUMBER, _MOST = 4, 1024
"""Bytes of the number of an item in the queue, and items of one queue: what the smallest pipe holds."""
_PROCESSES = 16
"""At most, with the parent: arrays of another process hold a file descriptor while they are used, and most systems
allow 1024."""
_ALIGNED = 64
"""Bytes at whose multiples arrays begin in the memory that they are sent through."""
_DEATH_SIGNAL = 1
"""PR_SET_PDEATHSIG of prctl(2)."""

_sharing = False
"""Whether this process is one of several that share the cores."""


@dataclass(frozen=True)
class _Way:
    """The channel for results of another process: the end of a pipe, and shared memory for arrays if there are any."""

    pipe: int
    memory: int | None

    def close(self) -> None:
        for end in (self.pipe, self.memory):
            if end is not None:
                os.close(end)


def cores() -> int:
    """Processors that this process may use now: 1 beside others of ``in_parallel``, and at most ``ARMSCOPE_CORES``."""
    if _sharing:
        return 1
    here = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    stated = os.environ.get(CORES, "")
    return max(1, min(here, int(stated))) if stated.isdecimal() else here


def in_parallel(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """``work`` of every item, in their order, on all ``cores``; in this process alone where a fork is not safe.

    Results must be such as pickle takes; what ``work`` keeps elsewhere (caches) may be lost. The first exception, in
    the order of the items, is raised. No process outlives the call, whatever ends it.
    """
    count = min(cores(), _PROCESSES, len(items))
    if count < 2 or len(items) > _MOST or not _forks_safely():
        return [work(item) for item in items]
    queue = _queue(len(items))
    others: dict[int, _Way] = {}
    try:
        with _shared():
            for _ in range(count - 1):
                _fork(work, items, queue, others)
            done = _done(work, items, queue)
        for way in others.values():
            done |= _received(way)
    finally:
        os.close(queue)
        _end(others)
    # failed items are computed again here, so that their exception is raised in this process
    return [done[number] if number in done else work(item) for number, item in enumerate(items)]


def _forks_safely() -> bool:
    """Whether a fork does what its parent would do.

    In a process of several threads, such as a notebook's, a lock that one of them holds is never released in a fork. On
    macOS the system's own frameworks do not survive one.
    """
    return hasattr(os, "fork") and sys.platform != "darwin" and threading.active_count() == 1


@contextmanager
def _shared() -> Iterator[None]:
    """While the block runs, ``cores`` is 1."""
    global _sharing
    _sharing = True
    try:
        yield
    finally:
        _sharing = False


def _queue(count: int) -> int:
    """A pipe that holds the numbers of all items, from which each process takes the next."""
    queue, end = os.pipe()
    os.write(end, b"".join(number.to_bytes(_NUMBER, "big") for number in range(count)))
    os.close(end)
    return queue


def _done(work: Callable[[T], R], items: Sequence[T], queue: int) -> dict[int, R]:
    """Results, by their numbers, of the items that this process takes; an exception leaves its item undone."""
    done: dict[int, R] = {}
    while number := os.read(queue, _NUMBER):
        index = int.from_bytes(number, "big")
        try:
            done[index] = work(items[index])
        except Exception:
            break
    return done


def _fork(work: Callable[[T], R], items: Sequence[T], queue: int, others: dict[int, _Way]) -> None:
    """Forks one more process that takes items from the queue; records its number and the channel of its results."""
    here, there = os.pipe()
    way = _Way(here, os.memfd_create("results") if hasattr(os, "memfd_create") else None)
    # an interrupt is the parent's to answer, which ends the other process
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process = os.fork()
        if process == 0:
            _work_and_exit(work, items, queue, there, way.memory)
        others[process] = way
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        os.close(there)


def _work_and_exit(work: Callable[[T], R], items: Sequence[T], queue: int, there: int, memory: int | None) -> NoReturn:
    """The forked process: nothing of its parent's is flushed or closed, whatever happens."""
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        if sys.platform == "linux":
            # ends with its parent; on other systems at the latest when it writes to the closed pipe
            ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)
        done, arrays = _done(work, items, queue), list[pickle.PickleBuffer]()
        text = pickle.dumps(done, pickle.HIGHEST_PROTOCOL, buffer_callback=None if memory is None else arrays.append)
        with os.fdopen(there, "wb") as pipe:
            pickle.dump((text, [] if memory is None else _shared_arrays(arrays, memory)), pipe)
    finally:
        os._exit(0)


def _shared_arrays(arrays: Sequence[pickle.PickleBuffer], memory: int) -> list[tuple[int, int]]:
    """Writes arrays one after the other; the bytes from which and up to which each of them lies there."""
    places, first = list[tuple[int, int]](), 0
    with os.fdopen(memory, "wb", closefd=False) as file:
        for array in arrays:
            raw = array.raw()
            file.seek(first)
            file.write(raw)
            places.append((first, first + raw.nbytes))
            first += -(-raw.nbytes // _ALIGNED) * _ALIGNED
        file.truncate(first)
    return places


def _received(way: _Way) -> dict[int, Any]:
    """The results that a process sends; empty for one that was killed."""
    with os.fdopen(way.pipe, "rb", closefd=False) as pipe:
        try:
            text, places = pickle.load(pipe)
        except (EOFError, pickle.UnpicklingError):
            return {}
    size = max((last for _, last in places), default=0)
    # private mapping: writes of a later fork are not seen here
    arrays = memoryview(
        mmap.mmap(way.memory, size, mmap.MAP_PRIVATE) if way.memory is not None and size else bytearray()
    )
    received: dict[int, Any] = pickle.loads(text, buffers=[arrays[first:last] for first, last in places])
    return received


def _end(others: dict[int, _Way]) -> None:
    """Every process has ended, and none is left to be waited for, when this returns."""
    for process, way in others.items():
        way.close()
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
