"""An external tracker: after its start pulse it samples at its own rate.

With each sample it raises the trigger line and sends a line of text.
"""

from __future__ import annotations

import contextlib
import os
import socket
import tempfile
import threading
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.tracker_stream import HEADING, METRES, Config, format_line
from sim_backend.protocol.serving import Loop, Terminal
from sim_backend.protocol.wires import Wires

START_LATENCY = 2_000_000
"""ns from the start pulse to the first sample at the earliest."""
JITTER = 15e-6
"""s, rms: how unevenly it samples."""


class SimulatedTracker:
    """The tracker.

    Faults for tests: ``clock_ppm``, ``lose_edges`` and ``lose_lines`` (frame numbers from 1), ``extra_edges`` (s after
    a frame, by its number), ``stop_after`` (frames), ``jitter``.
    """

    def __init__(self, name: str, config: Config, wires: Wires) -> None:
        self.name, self.config, self.wires = name, config, wires
        self.clock_ppm, self.jitter = 0.0, JITTER
        self.lose_edges: set[int] = set()
        self.lose_lines: set[int] = set()
        self.extra_edges: dict[int, float] = {}
        self.stop_after: int | None = None
        self.edges: list[int] = []  # ns of every sample of this run
        self._random = np.random.default_rng(1)
        self._lock = threading.RLock()
        self._loop = Loop(self._step, list)
        self._socket: socket.socket | None = None
        self._terminal = Terminal(name, config.serial, config.baud / 10) if config.serial is not None else None
        self._started: int | None = None
        self._made = 0
        self._saved: list[bytes] = []

    @property
    def address(self) -> str:
        if self._terminal is not None:
            return str(self._terminal.path)
        return f"sends to udp {self.config.host}:{self.config.port}"

    def open(self) -> None:
        self.plug_cable()
        self._loop.start()

    def close(self) -> None:
        self._loop.stop()
        self.pull_cable()

    def pull_cable(self) -> None:
        """Its data line, not its trigger line: it goes on sampling, and what it says meanwhile is lost."""
        with self._lock:
            if self._terminal is not None:
                self._terminal.close()
            if self._socket is not None:
                self._socket.close()
                self._socket = None

    def plug_cable(self) -> None:
        with self._lock:
            if self._terminal is not None:
                self._terminal.open()
            else:
                self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def reset(self) -> None:
        """Power off and on: it samples no more before the next start pulse, and its memory is empty."""
        with self._lock:
            self._started, self._saved = None, []

    def start(self, at: int) -> None:
        """The start pulse. A new run: frame numbers from 1, memory empty."""
        with self._lock:
            self._started, self._made, self.edges = at + START_LATENCY, 0, []
            self._saved = []

    def stop(self) -> None:
        """The start line has fallen: no more samples; the file is written."""
        with self._lock:
            if self._started is not None:
                self._started = None
                self._write_file()

    def _step(self, now: int) -> None:
        with self._lock:
            if self._terminal is not None:
                self._terminal.flush(now)
            if self._started is None:
                return
            last = min(self.config.memory or 1 << 62, self.stop_after or 1 << 62)
            period = 1e9 / (self.config.rate * (1 + self.clock_ppm * 1e-6))
            # A sample's jitter stays well inside half a period, so that samples keep their order.
            due = min(last, int((now - self._started) / period - 0.5))
            frames = np.arange(self._made + 1, due + 1)
            if len(frames):
                shake = np.clip(self._random.normal(0.0, self.jitter * 1e9, len(frames)), -0.4 * period, 0.4 * period)
                self._sample(frames, (self._started + frames * period + shake).astype(np.int64))
                self._made = due
            if self._made >= last:
                self.stop()

    def _sample(self, frames: NDArray[np.int64], at: NDArray[np.int64]) -> None:
        assert self._started is not None
        self.edges += at.tolist()
        edges = [int(t) for f, t in zip(frames, at) if int(f) not in self.lose_edges]
        edges += [int(t + 1e9 * self.extra_edges[int(f)]) for f, t in zip(frames, at) if int(f) in self.extra_edges]
        self.wires.trigger.add(np.array(sorted(edges), np.int64))
        points = self.wires.points(at) / METRES[self.config.unit]
        seconds = (at - self._started) * 1e-9 * (1 + self.clock_ppm * 1e-6)
        for frame, second, point, t in zip(frames, seconds, points, at):
            line = format_line(int(frame), float(second), point)
            self._saved.append(line)
            if int(frame) in self.lose_lines:
                continue
            if self._terminal is not None:
                self._terminal.write(line, int(t))
            elif self._socket is not None:
                with contextlib.suppress(OSError):
                    self._socket.sendto(line, (self.config.host, self.config.port or 0))

    def _write_file(self) -> None:
        if self.config.file is None:
            return
        path = Path(self.config.file)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name)
        with os.fdopen(handle, "wb") as file:
            file.write(HEADING.encode() + b"\n" + b"".join(self._saved))
        os.replace(temporary, path)


make = SimulatedTracker
