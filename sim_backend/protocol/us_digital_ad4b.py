"""A US Digital AD4-B on a pty, at the pace of 9600 baud."""

from __future__ import annotations

import numpy as np

from drivers.us_digital_ad4b import Config
from drivers.us_digital_ad4b import protocol as ad4b
from sim_backend.protocol.serving import OnTerminal, Terminal
from sim_backend.protocol.wires import Wires

BYTE_NS = int(10e9 / ad4b.BAUD)


class SimulatedAd4b(OnTerminal):
    """The adapter.

    Faults for tests: ``pull_cable``/``plug_cable``, ``reset``, ``corrupt`` (bytes -> bytes on its way out).
    """

    def __init__(self, name: str, config: Config, wires: Wires) -> None:
        super().__init__(name, Terminal(name, config.port, ad4b.BAUD / 10), period=None)
        self.wires = wires
        self._start = 0  # count of the wires at power-up
        self._multiplier = 1
        self._input = b""

    def reset(self, now: int) -> None:
        """Power off and on: not counting before it is initialised."""
        with self._lock:
            self._start, self._multiplier = int(self.wires.counts(0, np.array([now]))[0]), 0

    def _step(self, now: int) -> None:
        with self._lock:
            self._input += self._terminal.read()
            while self._input:
                length = 6 if self._input[0] == ad4b.INITIALISE else 1
                if len(self._input) < length:
                    break
                command, self._input = self._input[:length], self._input[length:]
                answer = self._answer(command, now)
                # Command and answer follow each other on the wire.
                self._terminal.write(self.corrupt(answer), now + len(command) * BYTE_NS)
            self._terminal.flush(now)

    def _answer(self, command: bytes, now: int) -> bytes:
        if command == ad4b.PING:
            return ad4b.PONG
        if command[0] == ad4b.INITIALISE:
            self._multiplier = command[1]
            return bytes([sum(command) & 0xFF])
        if command == ad4b.POSITION:
            # latched when the command byte has arrived
            moved = int(self.wires.counts(0, np.array([now]))[0]) - self._start
            count = moved * self._multiplier // 4
            return (count & 0xFFFFFF).to_bytes(3, "little") + b"\x00"
        return b""


make = SimulatedAd4b
