"""A serial port, read without waiting: pyserial, with an unplugged cable distinguished from silence."""

from __future__ import annotations

import contextlib
import os
import select
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")


class SerialPort:
    """8N1, no flow control, for this process alone. Every method raises OSError where the port is gone."""

    def __init__(self, path: str, baud: int, *, dtr: bool = True, rts: bool = True) -> None:
        self.path, self._baud, self._dtr, self._rts = path, baud, dtr, rts
        self._port: Any = None

    @property
    def is_open(self) -> bool:
        return self._port is not None

    def open(self) -> None:
        import serial

        self.close()
        port = serial.Serial(None, self._baud, timeout=0, write_timeout=1.0, exclusive=True)
        # Set before opening: on a pty, which has no such lines, setting them later raises ENOTTY.
        port.dtr, port.rts, port.port = self._dtr, self._rts, self.path
        try:
            port.open()
        except OSError as error:  # pyserial's own sentence names number and path, twice
            raise OSError(f"{self.path}: {os.strerror(error.errno) if error.errno else error}") from None
        # A USB adapter buffers bytes for 16 ms by default (FTDI's latency timer); ptys know of no such thing.
        with contextlib.suppress(ValueError, NotImplementedError):
            port.set_low_latency_mode(True)
        self._port = port

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def write(self, data: bytes) -> None:
        """Hands all of ``data`` to the kernel, which holds more than any command of ours."""
        with self._known():
            written = os.write(self._alive().fileno(), data)
        if written != len(data):
            raise OSError(f"{self.path} accepts no more data")

    def read(self) -> bytes:
        """All that has arrived, without waiting."""
        with self._known():
            port = self._alive()
            waiting = port.in_waiting
            return os.read(port.fileno(), waiting) if waiting else b""

    def wait_for(self, take: Callable[[bytes], T | None], seconds: float) -> T | None:
        """Feeds what arrives to ``take`` until it returns something; None after ``seconds``.

        A host that was suspended beyond that time looks once more: what had arrived in time is accepted.
        """
        file = self._alive().fileno()
        deadline = time.monotonic() + seconds
        remaining = seconds
        while remaining > 0:
            remaining = max(deadline - time.monotonic(), 0.0)
            if not select.select([file], [], [], remaining)[0]:
                continue
            with self._known():
                data = os.read(file, 4096)
            if not data:
                raise OSError(f"{self.path} is gone")  # ready to be read, and nothing there
            if (found := take(data)) is not None:
                return found
        return None

    def discard(self) -> int:
        """Throws away what has arrived and can be read; returns how many bytes."""
        return len(self.read())

    @contextlib.contextmanager
    def _known(self) -> Iterator[None]:
        """What the system says of a port that is gone (EIO and others), in words."""
        try:
            yield
        except OSError as error:
            raise OSError(f"{self.path} is gone" if error.errno else str(error)) from None

    def _alive(self) -> Any:
        if self._port is None:
            raise OSError(f"{self.path} is not open")
        return self._port


def serial_ports() -> list[str]:
    """The machine's serial ports, one sentence each; where udev gives a name that stays the same, that one."""
    from serial.tools.list_ports import comports

    by_id = {link.resolve(): str(link) for link in Path("/dev/serial/by-id").glob("*")}
    return [f"{by_id.get(Path(p.device), p.device)} ({p.description})" for p in comports() if p.description != "n/a"]
