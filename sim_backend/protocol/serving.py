"""A simulated device at work: one thread that sleeps until bytes or time move it."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

from arm_io import DeviceFault

AWAKE = 0.0003
"""s before and after the end of an answer."""


class Simulator(Protocol):
    """A device that answers at its address from ``open`` to ``close``. ``address`` says where, for a person."""

    name: str
    address: str

    def open(self) -> None: ...
    def close(self) -> None: ...


class Loop:
    """Calls ``step(now_ns)`` when one of ``files()`` is readable, and every ``period()`` s, from start to stop.

    It may be started again.
    """

    def __init__(
        self,
        step: Callable[[int], None],
        files: Callable[[], Iterable[int]],
        period: Callable[[], float] | float = 0.001,
    ) -> None:
        self._step, self._files = step, files
        self._period = period if callable(period) else (lambda: period)
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._error: BaseException | None = None

    def start(self) -> None:
        self._stopping.clear()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread, if there is one; raises what it died of, if it did."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
        self._thread = None
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                files = [f for f in self._files() if f >= 0]
                with contextlib.suppress(ValueError, OSError):
                    select.select(files, [], [], self._period())
                self._step(time.monotonic_ns())
        except BaseException as error:
            self._error = error


class Terminal:
    """A pty whose other end is reached through a symbolic link at ``path``, as a serial port under /dev is.

    ``bytes_per_second`` paces what is written, as the baud rate of the wire would; None: at once.
    """

    def __init__(self, name: str, path: str, bytes_per_second: float | None = None) -> None:
        self._name, self.path = name, Path(path)
        self._pace = bytes_per_second
        self._master = self._slave = -1
        self._waiting = bytearray()
        self._free_at = 0

    def open(self) -> None:
        if self.path.is_symlink():
            self.path.unlink()
        elif self.path.exists():
            raise DeviceFault(self._name, f"{self.path} exists and is no link: a simulated port would take its place")
        try:
            import termios
            import tty
        except ImportError:
            raise DeviceFault(self._name, "simulated serial ports need Linux or macOS; this system has none") from None
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave, termios.TCSANOW)
        os.set_blocking(self._master, False)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.symlink_to(os.ttyname(self._slave))

    def close(self) -> None:
        """Pulls the cable: the port is gone, and readers get nothing more."""
        if self._master >= 0:
            os.close(self._slave)
            os.close(self._master)
            self._master = self._slave = -1
            self.path.unlink(missing_ok=True)
        self._waiting.clear()

    def fileno(self) -> int:
        return self._master

    def read(self) -> bytes:
        """What has arrived; b'' if nothing."""
        if self._master < 0:
            return b""
        try:
            return os.read(self._master, 65536)
        except BlockingIOError:
            return b""

    def write(self, data: bytes, at: int) -> None:
        """Queues ``data``, which begins to go out at ns ``at``, or behind what still waits, at the pace of the wire.

        ``at`` may be over, where the simulator was held up: then all goes out at once that would have gone out by now.
        """
        if not self._waiting:
            self._free_at = max(self._free_at, at)
        self._waiting += data
        self.flush(time.monotonic_ns())

    def flush(self, now: int) -> None:
        """Puts on the wire what is due by ``now``. A line does not wait for its reader: what finds no room is lost."""
        if self._master < 0 or not self._waiting:
            return
        due = len(self._waiting)
        if self._pace is not None:
            due = min(due, int((now - self._free_at) * self._pace / 1e9))
        if due > 0:
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, bytes(self._waiting[:due]))
            del self._waiting[:due]
            if self._pace is not None:
                self._free_at += int(due / self._pace * 1e9)

    def until_due(self) -> float:
        """s for which the simulator may sleep: until shortly before all that waits can be on the wire; else 1 ms.

        Around that instant not at all: a device's UART is not woken up late, nor does it notice the next command late.
        """
        left = (self._free_at - time.monotonic_ns()) * 1e-9
        if not self._waiting or self._pace is None:
            return 0.0 if left > -AWAKE else 0.001
        return max(0.0, left + len(self._waiting) / self._pace - AWAKE)


class OnTerminal(ABC):
    """A simulator whose protocol is spoken on a terminal: life and cable of it.

    period   s between two steps where nothing arrives; None: ``Terminal.until_due``
    corrupt  fault for tests: bytes -> bytes on their way out
    """

    def __init__(self, name: str, terminal: Terminal, period: float | None = 0.001) -> None:
        self.name = name
        self.corrupt: Callable[[bytes], bytes] = lambda data: data
        self._terminal = terminal
        self._lock = threading.RLock()
        due = terminal.until_due if period is None else period
        self._loop = Loop(self._step, lambda: [terminal.fileno()], due)

    @property
    def address(self) -> str:
        return str(self._terminal.path)

    def open(self) -> None:
        self._terminal.open()
        self._loop.start()

    def close(self) -> None:
        self._loop.stop()
        self._terminal.close()

    def pull_cable(self) -> None:
        with self._lock:
            self._terminal.close()

    def plug_cable(self) -> None:
        with self._lock:
            self._terminal.open()

    @abstractmethod
    def _step(self, now: int) -> None:
        """Answers what has arrived, at ns ``now`` of the host."""


class Listener:
    """One TCP port with at most one connection; a new one takes the place of the old."""

    def __init__(self, host: str, port: int) -> None:
        self.host, self.port = host, port
        self._listening: socket.socket | None = None
        self.connection: socket.socket | None = None

    def open(self) -> None:
        self._listening = socket.create_server((self.host, self.port), backlog=4)
        self.port = self._listening.getsockname()[1]
        self._listening.setblocking(False)

    def close(self) -> None:
        """Unplugs the cable: no port listens, and a connection is cut."""
        self.drop()
        if self._listening is not None:
            self._listening.close()
            self._listening = None

    def drop(self) -> None:
        if self.connection is not None:
            self.connection.close()
            self.connection = None

    def files(self) -> list[int]:
        return [s.fileno() for s in (self._listening, self.connection) if s is not None]

    def accept(self) -> bool:
        """Takes a waiting connection, if there is one."""
        if self._listening is None:
            return False
        try:
            connection, _ = self._listening.accept()
        except OSError:
            return False
        self.drop()
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        return True

    def receive(self) -> bytes:
        """What has arrived; b'' if nothing. A connection that the other end closed is dropped."""
        if self.connection is None:
            return b""
        try:
            data = self.connection.recv(65536)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.drop()
        return data

    def send(self, data: bytes) -> int:
        """Bytes taken by the network; 0 if it has no room or no client is connected."""
        if self.connection is None:
            return 0
        try:
            return self.connection.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self.drop()
            return 0
