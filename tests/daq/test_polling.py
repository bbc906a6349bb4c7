"""Devices that have to be asked: a thread each on the real clock, their own grid, their faults, their gaps."""

from __future__ import annotations

import re
import threading
import time

import numpy as np
import pytest

from arm_io import DeviceFault
from daq.acquisition.device_stream import Stream
from daq.acquisition.polling import Poller
from daq.acquisition.rows import Rows, without_value
from daq.rig.channels import Columns
from drivers.blocks import missing_row, one_row
from drivers.clock import SystemClock
from drivers.protocols import Block, Quality


class Asked:
    """Answers with how often it was asked; may be slow, may fail."""

    name = "asked"

    def __init__(self, fails_after: int | None = None, slow_at: int = -1) -> None:
        self.asked, self.fails_after, self.slow_at = 0, fails_after, slow_at
        self.enough = threading.Event()

    def poll(self) -> Block:
        self.asked += 1
        if self.fails_after is not None and self.asked > self.fails_after:
            self.enough.set()
            raise DeviceFault(self.name, "is gone")
        if self.asked == self.slow_at:
            time.sleep(0.02)
        if self.asked > 20:
            self.enough.set()
        return one_row(time.monotonic_ns(), [self.asked], quality=[0])


def _collect(poller: Poller, device: Asked) -> Block:
    poller.start(time.monotonic_ns())
    assert device.enough.wait(10.0)
    poller.stop()
    block = poller.read()
    assert block is not None and block.counts is not None
    assert block.counts[:, 0].tolist() == list(range(1, len(block) + 1))
    return block


def test_rows_lie_on_the_grid_and_a_tick_that_came_while_busy_is_skipped() -> None:
    device = Asked(slow_at=6)
    poller = Poller(device, SystemClock(), 0.004)
    block = _collect(poller, device)
    assert block.number[0] == 0
    steps = np.diff(block.number)
    assert (steps >= 1).all() and steps[5] >= 4  # 20 ms of 4 ms each
    late = block.quality[:, 0] == Quality.LATE
    assert late[5] and np.count_nonzero(late) <= len(late) // 2
    due = poller._begin + block.number * poller.period_ns
    assert (block.host >= due).all()


def test_a_fault_is_told_after_the_rows_before_it() -> None:
    device = Asked(fails_after=3)
    poller = Poller(device, SystemClock(), 0.002)
    assert len(_collect(poller, device)) == 3
    with pytest.raises(DeviceFault, match="is gone"):
        poller.read()
    assert not poller.running


def test_a_driver_that_crashes_is_a_fault_with_its_words() -> None:
    class Broken(Asked):
        def poll(self) -> Block:
            self.enough.set()
            raise ZeroDivisionError("division by zero")

    device = Broken()
    poller = Poller(device, SystemClock(), 0.002)
    poller.start(time.monotonic_ns())
    assert device.enough.wait(10.0)
    poller.stop()
    with pytest.raises(DeviceFault, match="its driver failed: ZeroDivisionError: division by zero"):
        poller.read()


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (
            one_row(0, [1], quality=[0]),
            "poll() gave 1 row of 1 counts, 0 volts and 1 qualities; the device has 2 counters",
        ),
        (one_row(0, [1, 2], quality=[0]), "1 qualities; the device has 2 counters and 0 inputs"),
        ((1, 2), "its driver failed: "),
    ],
)
def test_a_row_that_is_not_of_the_device_is_a_fault_of_its_driver(row: Block, said: str) -> None:
    class Odd(Asked):
        width = (24, 24)

        def poll(self) -> Block:
            self.enough.set()
            return row

    device = Odd()
    poller = Poller(device, SystemClock(), 0.002)
    poller.start(time.monotonic_ns())
    assert device.enough.wait(10.0)
    poller.stop()
    with pytest.raises(DeviceFault, match=re.escape(said)):
        poller.read()


def test_rows_without_a_value_are_counted_by_device() -> None:
    columns = Columns((("card", 0), ("card", 1), ("other", 0)), (8, 8, 8), (("volts", 0),), "tracker")
    quality = np.zeros((5, 5), np.uint8)
    quality[:2, 0] = quality[1:3, 1] = Quality.MISSING
    quality[4, 2] = Quality.STALE
    quality[0, 3] = Quality.MISSING | Quality.LATE
    quality[:, 4] = Quality.MISSING  # a beam may be interrupted
    none = np.zeros(5, np.int64)
    rows = Rows(none, none, none, none, np.zeros((5, 3), np.int64), np.zeros((5, 1)), quality, none, none)
    assert without_value(columns, rows) == {"card": 3, "volts": 1}


def test_rows_without_a_value_do_not_break_the_count_of_a_register_that_wraps() -> None:
    columns = Columns((("asked", 0),), (8,), (), None)
    stream = Stream("asked", columns, 1e6, by_time=True, presets={0: 250})
    counts: list[int | None] = [250, 254, None, None, 3, 9, None, 20]
    for number, count in enumerate(counts):
        row = missing_row(number, 1, 0) if count is None else one_row(number, [count], quality=[0])
        stream.push(Block(np.array([number]), row.host, row.tick, row.quality, counts=row.counts))
    assert stream.ready is not None
    assert stream.ready["counts"][:, 0].tolist() == [250, 254, 254, 254, 259, 265, 265, 276]
    assert ((stream.ready["quality"][:, 0] & Quality.MISSING) != 0).tolist() == [c is None for c in counts]
    together = Stream("asked", columns, 1e6, by_time=True, presets={0: 250})
    n = len(counts)
    together.push(
        Block(
            np.arange(n),
            np.arange(n),
            np.zeros(n, np.int64),
            np.array([[Quality.MISSING if c is None else 0] for c in counts], np.uint8),
            counts=np.array([[c or 0] for c in counts]),
        )
    )
    assert together.ready is not None
    assert np.array_equal(together.ready["counts"], stream.ready["counts"])
