"""A counter device of the Linux counter subsystem: its tree of attribute files, in an ordinary folder.

Ordinary files cannot run code when they are read, as sysfs does: the counts are written anew every millisecond.
"""

from __future__ import annotations

import os
import shutil
import threading
from pathlib import Path

import numpy as np

from arm_io import InputError
from drivers.linux_counter import FUNCTIONS, SYSFS, Config
from drivers.protocols import CounterMode
from sim_backend.protocol.serving import Loop
from sim_backend.protocol.wires import Wires

DIVISOR = {FUNCTIONS[CounterMode.X1]: 4, FUNCTIONS[CounterMode.X2]: 2, FUNCTIONS[CounterMode.X4]: 1}
FIELD = 24
"""Bytes: a count is always written over the whole of the last one."""


class SimulatedCounter:
    """The folder. Faults for tests: ``unload``/``load`` (the kernel module)."""

    def __init__(self, name: str, config: Config, wires: Wires) -> None:
        if config.sysfs == SYSFS:
            raise InputError(name, f"sysfs: a simulated counter cannot be in {SYSFS}; use another folder")
        self.name, self.config, self.wires = name, config, wires
        self._folder = Path(config.sysfs) / config.device
        self._mask = (1 << config.bits) - 1
        self._files: list[int] = []
        self._lock = threading.RLock()
        self._loop = Loop(self._step, list, 0.001)

    @property
    def address(self) -> str:
        return str(self._folder)

    def open(self) -> None:
        self.load()
        self._loop.start()

    def close(self) -> None:
        self._loop.stop()
        self.unload()

    def load(self) -> None:
        """Fresh attributes, as after loading the module: function increase, disabled, count 0."""
        with self._lock:
            for number in self.config.counts:
                folder = self._folder / f"count{number}"
                folder.mkdir(parents=True, exist_ok=True)
                for attribute, value in (
                    ("function", "increase"),
                    ("ceiling", str(self._mask)),
                    ("enable", "0"),
                    ("preset", "0"),
                    ("preset_enable", "0"),
                ):
                    (folder / attribute).write_text(f"{value}\n")
                (folder / "count").write_bytes(_padded(0))
            (self._folder / "name").write_text("104-quad-8\n")
            self._files = [os.open(self._folder / f"count{n}" / "count", os.O_RDWR) for n in self.config.counts]
            self._shown = [0] * len(self._files)
            self._base = [0] * len(self._files)

    def unload(self) -> None:
        with self._lock:
            for file in self._files:
                os.ftruncate(file, 0)  # whoever still has it open finds nothing in it
                os.close(file)
            self._files = []
            shutil.rmtree(self._folder, ignore_errors=True)

    def _step(self, now: int) -> None:
        with self._lock:
            for channel, file in enumerate(self._files):
                folder = self._folder / f"count{self.config.counts[channel]}"
                divisor = DIVISOR.get((folder / "function").read_text().strip())
                text = os.pread(file, 64, 0).split(b"\n", 1)[0]
                written = int(text) if text.isdigit() else self._shown[channel]
                raw = 0
                if divisor is not None:
                    raw = int(self.wires.counts(channel, np.array([now], np.int64))[0]) // divisor
                if written != self._shown[channel] or (folder / "enable").read_text().strip() == "0":
                    self._base[channel] = written - raw
                self._shown[channel] = (raw + self._base[channel]) & self._mask
                os.pwrite(file, _padded(self._shown[channel]), 0)


def _padded(count: int) -> bytes:
    return str(count).encode().rjust(FIELD - 1, b"0") + b"\n"


make = SimulatedCounter
