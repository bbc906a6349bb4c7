"""A US Digital QSB on a pty: registers, streaming at the pace of 230400 baud, power-up defaults."""

from __future__ import annotations

import re
import time

import numpy as np

from drivers.us_digital_qsb import Config
from drivers.us_digital_qsb import protocol as qsb
from sim_backend.protocol.serving import OnTerminal, Terminal
from sim_backend.protocol.wires import Wires

_COMMAND = re.compile(rb"([RWS])([0-9A-Fa-f]{2})([0-9A-Fa-f]*)")
HELD_UP, MOST_HELD_UP = 1_000_000, 20  # ns for counting and sending; times in a row
KNOWN = (qsb.MDR0, qsb.CLEAR, qsb.INTERVAL, qsb.TIME, qsb.COUNT, qsb.VERSION, qsb.OPTIONS)


class SimulatedQsb(OnTerminal):
    """The adapter.

    Faults for tests: ``pull_cable``/``plug_cable``, ``reset``, ``corrupt`` (bytes -> bytes on its way out).
    """

    def __init__(self, name: str, config: Config, wires: Wires) -> None:
        super().__init__(name, Terminal(name, config.port, qsb.BAUD / 10), period=0.0005)
        self.wires = wires
        self.mute = False
        self.reset(time.monotonic_ns())

    def pull_cable(self) -> None:
        """USB is its power, too."""
        with self._lock:
            super().pull_cable()
            self.reset(time.monotonic_ns())

    def reset(self, now: int) -> None:
        with self._lock:
            self._since, self._input = now, b""
            self._registers = {qsb.MDR0: 0, qsb.INTERVAL: 0, qsb.OPTIONS: 3, qsb.VERSION: 0x00053F14}
            self._streaming: int | None = None
            self._zero = 0
            self._next = 0

    def _step(self, now: int) -> None:
        with self._lock:
            self._input += self._terminal.read()
            while b"\r" in self._input:
                command, self._input = self._input.split(b"\r", 1)
                self._command(command, now)
            self._stream(now)
            self._terminal.flush(now)

    def _stream(self, now: int) -> None:
        """As many replies as fit on the wire since the last; each with the count at its own instant."""
        if self._streaming is None:
            return
        interval = (
            self._registers[qsb.INTERVAL] / qsb.TIME_HZ
            or (12 + 2 * (self._registers[qsb.OPTIONS] & 3 == 3)) * 10 / qsb.BAUD
        )
        for _ in range(MOST_HELD_UP):
            due = int((now - self._next) / 1e9 / interval) + 1
            if due <= 0:
                return
            at = self._next + (np.arange(due) * interval * 1e9).astype(np.int64)
            replies = b"".join(self._reply("s", self._streaming, int(c)) for c in self._counts(at))
            # Nothing holds a QSB up between counting and sending; this process may be, and then counts once more.
            begun, now = now, time.monotonic_ns()
            if now - begun < HELD_UP:
                break
        self._next += int(due * interval * 1e9)
        self._send(replies, int(at[0]))

    def _counts(self, at: np.ndarray) -> np.ndarray:
        multiplier = {1: 4, 2: 2, 3: 1}.get(self._registers[qsb.MDR0] & 3)
        if multiplier is None:
            return np.zeros(len(at), np.int64)
        return (self.wires.counts(0, at) // multiplier - self._zero) & 0xFFFFFFFF

    def _command(self, command: bytes, now: int) -> None:
        self._streaming = None
        match = _COMMAND.fullmatch(command.strip())
        if match is None:
            self._send(b"x00" + b"0" * 8 + b"!", now)
            return
        kind, register, data = match[1].decode(), int(match[2], 16), match[3]
        if register not in KNOWN:
            self._send(self._reply("e", register, 0), now)
            return
        if kind == "W":
            self._registers[register] = int(data or b"0", 16)
            if register == qsb.CLEAR or register == qsb.MDR0:
                self._zero = 0
                self._zero = int(self._counts(np.array([now]))[0])
        if kind == "S":
            self._streaming, self._next = register, now
            return
        self._send(self._reply(kind.lower(), register, self._read(register, now)), now)

    def _read(self, register: int, now: int) -> int:
        if register == qsb.COUNT:
            return int(self._counts(np.array([now]))[0])
        if register == qsb.TIME:
            return int((now - self._since) * qsb.TIME_HZ / 1e9)
        return self._registers.get(register, 0)

    def _reply(self, kind: str, register: int, value: int) -> bytes:
        options = self._registers[qsb.OPTIONS]
        end = b"\r" * (options >> 1 & 1) + b"\n" * (options & 1)
        return b"%s%02X%08X!" % (kind.encode(), register, value & 0xFFFFFFFF) + end

    def _send(self, data: bytes, at: int) -> None:
        if not self.mute:
            self._terminal.write(self.corrupt(data), at)


make = SimulatedQsb
