"""Devices without a latch, asked on a time grid: the rows that the host makes by asking.

A device on a serial line or a bus answers when it is asked, and its answers are joined by their time. With the real
clock each has a thread of its own, so that a slow one does not delay the others; on a clock of its own (a simulation),
the sampler's sleep asks them.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Protocol

import numpy as np

from arm_io import DeviceFault
from drivers import SystemClock, join
from drivers.protocols import Block, HostClock, Quality


class PolledDevice(Protocol):
    """The part of a device that a poller uses."""

    name: str

    def poll(self) -> Block: ...


class Poller:
    """Asks one device every ``period`` s; row numbers are those of the ticks of the grid, from 0 at ``start``.

    A tick that comes while the device is still busy with the one before is skipped: its number is missing.
    """

    def __init__(self, device: PolledDevice, clock: HostClock, period: float) -> None:
        self.device, self.clock = device, clock
        self.period_ns = round(period * 1e9)
        self.threaded = isinstance(clock, SystemClock)
        self.due = 0  # host ns of the next tick
        self._number = 0
        self._rows: list[Block] = []
        self._fault: Exception | None = None
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self, begin: int) -> None:
        """The grid begins one period after host time ``begin`` ns."""
        self._number, self._rows, self._fault = 0, [], None
        self._begin = begin + self.period_ns
        self.due = self._begin
        self._stop.clear()
        if self.threaded:
            self._thread = threading.Thread(target=self._run, name=f"poll {self.device.name}", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """No more asking; rows made so far can still be read."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
            self._thread = None

    def read(self) -> Block | None:
        """All rows since the last call; None if there are none.

        Raises what the device raised, once its rows are read.
        """
        with self._lock:
            rows, self._rows = self._rows, []
        if rows:
            first = rows[0]
            columns = (first.counts is not None, first.volts is not None)
            return join(rows, *columns, points=first.points is not None)
        if self._fault is not None:
            raise self._fault
        return None

    def ask(self) -> None:
        """One row, for the tick that is due; the next is due at the next tick after the answer.

        An answer that took longer than the period is LATE: the moment of sampling within that time is unknown.
        """
        before = self.clock.monotonic_ns()
        try:
            row = _checked(self.device, self.device.poll())
        except DeviceFault as fault:
            self._fault = fault
            self._stop.set()
            return
        except Exception as error:
            self._fault = DeviceFault(self.device.name, f"its driver failed: {type(error).__name__}: {error}")
            self._stop.set()
            return
        after = self.clock.monotonic_ns()
        quality = row.quality | np.uint8(Quality.LATE) if after - before > self.period_ns else row.quality
        with self._lock:
            self._rows.append(replace(row, number=np.array([self._number]), quality=quality))
        passed = (after - self._begin) // self.period_ns
        self._number = max(self._number, int(passed)) + 1
        self.due = self._begin + self._number * self.period_ns

    @property
    def running(self) -> bool:
        """False once stopped or failed."""
        return not self._stop.is_set()

    def _run(self) -> None:
        while self.running:
            wait = (self.due - self.clock.monotonic_ns()) * 1e-9
            if wait > 0 and self._stop.wait(wait):
                return
            self.ask()


def _checked(device: PolledDevice, row: Block) -> Block:
    """One row with a value and a quality of each channel that the device states; ValueError, AttributeError else."""
    values = {"width": row.counts, "range_volts": row.volts}
    made = {name: 0 if one is None else one.shape[-1] for name, one in values.items()}
    stated = {name: len(getattr(device, name)) if hasattr(device, name) else made[name] for name in values}
    if len(row) != 1 or made != stated or row.quality.shape[-1] < sum(stated.values()):
        raise ValueError(
            f"poll() gave {len(row)} row of {made['width']} counts, {made['range_volts']} volts and "
            f"{row.quality.shape[-1]} qualities; the device has {stated['width']} counters and "
            f"{stated['range_volts']} inputs"
        )
    return row


def sleep_until(clock: HostClock, until: int, pollers: list[Poller]) -> None:
    """Sleeps on the rig's clock until host time ``until`` ns; pollers without a thread are asked on the way."""
    while True:
        waiting = [p for p in pollers if not p.threaded and p.running and p.due <= until]
        due = min(waiting, key=lambda p: p.due, default=None)
        wait = ((until if due is None else due.due) - clock.monotonic_ns()) * 1e-9
        if wait > 0:
            clock.sleep(wait)
        if due is None:
            return
        due.ask()
