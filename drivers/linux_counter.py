"""Encoder counters of the Linux counter subsystem (104-QUAD-8, STM32, TI eQEP ...), read through sysfs.

Documented in the kernel under Documentation/ABI/testing/sysfs-bus-counter. Every channel is latched at its own read:
the skew between channels is measured when the device is opened, and stated.
"""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path
from typing import Annotated

from pydantic import Field

from arm_io import DeviceFault
from arm_io.table import NoSeconds, Table
from drivers.blocks import one_row
from drivers.counting import check_channel
from drivers.protocols import Block, CounterMode, HostClock, Identity, Plan, Quality
from drivers.reconnect import Reconnect, or_fault
from drivers.rig_context import RigContext

ADVICE = "is the counter's kernel module loaded?"
SYSFS = "/sys/bus/counter/devices"
FUNCTIONS = {CounterMode.X1: "quadrature x1 a", CounterMode.X2: "quadrature x2 a", CounterMode.X4: "quadrature x4"}
TRIAL_READS = 32
PRESET_TRIES, PRESET_PAUSE, PRESET_SLACK = 5, 0.005, 500  # times, s, counts that it may have moved on by then


class Config(Table):
    """A counter device in the rig file.

    device  its name under /sys/bus/counter/devices, such as counter0
    counts  numbers of its counts (countN); counter channels in this order
    bits    of the hardware register (104-QUAD-8: 24)
    sysfs   the subsystem's folder
    """

    device: str = "counter0"
    counts: tuple[Annotated[int, Field(ge=0)], ...] = (0, 1, 2)
    bits: Annotated[int, Field(ge=8, le=64)] = 24
    sysfs: str = SYSFS
    patience: NoSeconds = 5.0


class LinuxCounter:
    """The device (shapes: Polled, QuadratureCounter)."""

    def __init__(self, name: str, config: Config, clock: HostClock) -> None:
        self.name, self.config, self._clock = name, config, clock
        self.width = (config.bits,) * len(config.counts)
        self._folder = Path(config.sysfs) / config.device
        self._files: list[int] = []
        self._reset: list[bool] = []
        self._reconnect = Reconnect(name, config.patience, ADVICE, self.close)

    def open(self) -> Identity:
        with or_fault(self.name, ADVICE, self.close):
            model = (self._folder / "name").read_text().strip()
            for channel in range(len(self.config.counts)):
                self.configure(channel, CounterMode.X4)
            self._open_files()
            skew, row = self._trial()
            self._fastest = 1.0 / row
        return Identity(
            maker="Linux counter subsystem",
            model=model,
            max_rate=self._fastest,
            channel_skew=skew,
            bits=self.config.bits,
            details={"sysfs": str(self._folder)},
        )

    def _trial(self) -> tuple[float, float]:
        """Seconds between neighbouring channels and for a whole row, the median of a few."""
        times = []
        for _ in range(TRIAL_READS):
            before = time.perf_counter()
            for file in self._files:
                parse_count(os.pread(file, 64, 0))
            times.append(time.perf_counter() - before)
        row = sorted(times)[TRIAL_READS // 2]
        return row / len(self._files), row

    def check(self) -> list[str]:
        problems = []
        for channel, number in enumerate(self.config.counts):
            try:
                function = self._read(number, "function")
                if function not in FUNCTIONS.values():
                    problems.append(f"count{number} does {function!r}, not quadrature: open the rig again")
                if self._read(number, "enable") == "0":
                    problems.append(f"count{number} is disabled: open the rig again")
                ceiling = int(self._read(number, "ceiling"))
                if ceiling != (1 << self.width[channel]) - 1:
                    problems.append(f"count{number} wraps at {ceiling}, not at 2^{self.width[channel]}: correct 'bits'")
            except (OSError, ValueError) as error:
                problems.append(f"{error}; {ADVICE}")
        return problems

    def arm(self, plan: Plan) -> None:
        if not self._files:
            raise self._fault("is not open")
        if plan.rate > self._fastest:
            raise self._fault(
                f"{plan.rate:g} rows/s requested, {self._fastest:.0f} possible, as measured when it was opened"
            )
        self._reset = [False] * len(self._files)
        self._reconnect.begin()

    def disarm(self) -> None: ...

    def close(self) -> None:
        for file in self._files:
            with contextlib.suppress(OSError):
                os.close(file)
        self._files = []

    def poll(self) -> Block:
        return self._reconnect.poll(self._clock, self._reopen, self._latched, (len(self.config.counts), 0))

    def _latched(self, now: int) -> Block:
        try:
            counts = [parse_count(os.pread(file, 64, 0)) for file in self._files]
        except ValueError as error:
            raise OSError(str(error)) from None
        after = self._clock.monotonic_ns()
        quality = [int(Quality.DEVICE_RESET if reset else Quality.GOOD) for reset in self._reset]
        return one_row((now + after) // 2, counts, quality=quality)

    def _reopen(self) -> None:
        """The module was unloaded and loaded again: its counts began anew."""
        for channel in range(len(self.config.counts)):
            self.configure(channel, CounterMode.X4)
        self._open_files()
        self._reset = [True] * len(self._files)

    def configure(self, channel: int, mode: CounterMode) -> None:
        check_channel(self.name, channel, len(self.width))
        number = self.config.counts[channel]
        with or_fault(self.name, f"can count{number} do {FUNCTIONS[mode]!r}?"):
            self._write(number, "enable", "0")
            self._write(number, "function", FUNCTIONS[mode])
            with contextlib.suppress(OSError):  # some counters have a fixed ceiling
                self._write(number, "ceiling", str((1 << self.width[channel]) - 1))
            self._write(number, "enable", "1")

    def preset(self, channel: int, value: int) -> None:
        """Writes the count and reads it back.

        DeviceFault if it was not accepted: some counters have no preset.
        """
        check_channel(self.name, channel, len(self.width))
        number, mask = self.config.counts[channel], (1 << self.width[channel]) - 1
        caught = f"count{number} does not take the count {value}: does its hardware have a preset?"
        for _ in range(PRESET_TRIES):
            try:
                self._write(number, "count", str(value & mask))
                self._clock.sleep(PRESET_PAUSE)
                away = (parse_count(self._read(number, "count").encode() + b"\n") - value) & mask
            except ValueError as error:
                caught = f"{error}; its count cannot be set"
                continue
            except OSError as error:
                raise self._fault(f"{error}; its count cannot be set") from None
            if min(away, mask + 1 - away) <= PRESET_SLACK:
                return
        raise self._fault(caught)

    def index_enable(self, channel: int) -> None:
        """Arms a load of ``preset`` (set to 0) at the next index pulse, where the counter has it."""
        check_channel(self.name, channel, len(self.width))
        number = self.config.counts[channel]
        with or_fault(self.name, "it has no index input"):
            self._write(number, "preset", "0")
            self._write(number, "preset_enable", "1")

    def index_seen(self, channel: int) -> int | None:
        return None  # sysfs does not report it; a count near 0 after index_enable does

    def _open_files(self) -> None:
        self.close()
        for number in self.config.counts:
            self._files.append(os.open(self._folder / f"count{number}" / "count", os.O_RDONLY))

    def _read(self, number: int, attribute: str) -> str:
        return (self._folder / f"count{number}" / attribute).read_text().strip()

    def _write(self, number: int, attribute: str, text: str) -> None:
        # As sysfs requires: no new file, no truncation, one write.
        file = os.open(self._folder / f"count{number}" / attribute, os.O_WRONLY)
        try:
            os.write(file, text.encode() + b"\n")
        finally:
            os.close(file)

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def parse_count(text: bytes) -> int:
    """A sysfs count attribute: one decimal number and a newline. ValueError for anything else."""
    if not text.endswith(b"\n") or not text.strip().isdigit():
        raise ValueError(f"{text[:32]!r} is not a count")
    return int(text)


def make(name: str, config: Config, context: RigContext) -> LinuxCounter:
    """The counter at ``config.device``, closed."""
    return LinuxCounter(name, config, context.clock)


def find(config: Config) -> list[str]:
    """The counters that the kernel knows."""
    return [f"{folder.name} under {config.sysfs}" for folder in sorted(Path(config.sysfs).glob("counter*"))]
