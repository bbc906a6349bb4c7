"""A serial port, read without waiting; a thin skin over pyserial that tells a pulled cable from silence."""

from __future__ import annotations

import select
import time
from collections.abc import Callable
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
        port.open()
        self._port = port

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def write(self, data: bytes) -> None:
        self._alive().write(data)

    def read(self) -> bytes:
        """All that has arrived, without waiting."""
        port = self._alive()
        waiting = port.in_waiting
        return bytes(port.read(waiting)) if waiting else b""

    def wait_for(self, take: Callable[[bytes], T | None], seconds: float) -> T | None:
        """Feeds what arrives to ``take`` until it returns something; None after ``seconds``. A host that comes back later than
        that looks once more: what came in time is taken."""
        deadline = time.monotonic() + seconds
        left = seconds
        while left > 0:
            left = max(deadline - time.monotonic(), 0.0)
            ready, _, _ = select.select([self._alive().fileno()], [], [], left)
            if ready:
                data = bytes(self._alive().read(4096))  # raises where the port is ready but has nothing: it is gone
                if (found := take(data)) is not None:
                    return found
        return None

    def discard(self) -> int:
        """Throws away what has arrived; returns how many bytes."""
        return len(self.read())

    def _alive(self) -> Any:
        if self._port is None:
            raise OSError(f"{self.path} is not open")
        return self._port


def serial_ports() -> list[str]:
    """The machine's serial ports, one sentence each; where udev gives a name that stays the same, that one."""
    from serial.tools.list_ports import comports

    by_id = {link.resolve(): str(link) for link in Path("/dev/serial/by-id").glob("*")}
    return [f"{by_id.get(Path(p.device), p.device)} ({p.description})" for p in comports() if p.description != "n/a"]
