"""Commands that wait for the thread that obeys them; ``stop`` goes ahead of all others and is never refused."""

from __future__ import annotations

import queue
from collections import deque
from typing import TYPE_CHECKING

from arm_io import DeviceFault, InputError

if TYPE_CHECKING:
    from daq.service.commands.server import Command

MOST_WAITING = 256
"""Commands that may wait; each costs the thread that obeys less than a millisecond."""


class CommandQueue:
    """Filled by Zenoh's threads, emptied by one thread; ``wake`` may also be called from a signal handler."""

    def __init__(self) -> None:
        self._first: deque[Command] = deque()
        self._others: deque[Command] = deque()
        # One entry for each command and each call of wake. SimpleQueue.put is reentrant: signal handlers may use it.
        self._signals: queue.SimpleQueue[None] = queue.SimpleQueue()

    def put(self, command: Command) -> None:
        """Adds a command; refuses it at once where too many wait already."""
        if command.verb == "stop":
            self._first.append(command)
        elif len(self._others) >= MOST_WAITING:
            command.refuse(InputError("daemon", f"has {MOST_WAITING} commands waiting; send fewer at a time"))
            return
        else:
            self._others.append(command)
        self._signals.put(None)

    def wake(self) -> None:
        """Makes a waiting ``next`` return; from any thread or signal handler."""
        self._signals.put(None)

    def next(self, timeout: float | None = None) -> Command | None:
        """The next command; waits at most ``timeout`` s (0: not at all; None: for ever). None if there was none."""
        try:
            self._signals.get(timeout != 0, timeout)
        except queue.Empty:
            return None
        for waiting in (self._first, self._others):
            if waiting:
                return waiting.popleft()
        return None

    def close(self) -> None:
        """Refuses every command that still waits."""
        for waiting in (self._first, self._others):
            while waiting:
                waiting.popleft().refuse(DeviceFault("daemon", "is stopping"))
