"""Answers of a T7 that are held up, as a busy computer or network does, while its rows are told from one another.

Its CORE_TIMER is known to half a round trip. What rests on one slow reading is off by milliseconds: rows of other
triggers than they say.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from arm_io import DeviceFault
from drivers import RigContext
from drivers.blocks import join
from drivers.labjack_t7 import device as driver
from drivers.labjack_t7 import protocol as t7
from drivers.modbus_tcp import Frame
from drivers.protocols import Block, EdgeSource, Plan, Quality
from sim_backend.protocol import labjack_t7 as simulator
from tests.drivers.swing import read_rows, swing_wires, volts
from tests.drivers.test_labjack_t7 import config

LATE = 0.009  # s: four and a half triggers
RATE = 500.0
VOLT = 1e-3  # V: a row's motion is up to 9 of these, the converter's step a third


class SlowWay:
    """The way back from a T7: its next ``late`` answers to readings of CORE_TIMER are held up for ``LATE`` s."""

    def __init__(self, box: simulator.SimulatedT7) -> None:
        self.late = 0
        self._answer, self._send, self._slow = box._answer, box._command.send, False
        box._answer, box._command.send = self.answer, self.send

    def answer(self, frame: Frame, now: int) -> Frame:
        self._slow = self.late > 0 and frame.body[:2] == struct.pack(">H", t7.CORE_TIMER)
        self.late -= self._slow
        return self._answer(frame, now)

    def send(self, data: bytes) -> int:
        if self._slow:
            time.sleep(LATE)
        return self._send(data)


Rig = tuple[driver.LabJackT7, simulator.SimulatedT7, SlowWay]


@pytest.fixture
def rig() -> Iterator[Rig]:
    box = simulator.make("t7", config(counters=(0,), inputs=(0,), patience=1.0), swing_wires())
    slow = SlowWay(box)
    box.open()
    device = driver.make("t7", box.config, RigContext())
    device.open()
    yield device, box, slow
    device.close()
    box.close()


def armed(device: driver.LabJackT7, box: simulator.SimulatedT7) -> NDArray[np.int64]:
    """Arms it on a line of even triggers, as a tracker makes them: host ns of all edges of the next 10 s."""
    device.arm(Plan(EdgeSource.TRACKER, RATE, None))
    edges = time.monotonic_ns() + (np.arange(5000) * 1e9 / RATE).astype(np.int64)
    box.wires.trigger.add(edges)
    return edges


def off(rows: Block, edges: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n,) V by which rows differ from the signal at the edge whose number they have."""
    assert rows.volts is not None
    return np.abs(rows.volts[:, 0] - volts(0, edges[rows.number]))


def test_rows_after_a_restart_are_those_of_their_triggers_though_an_answer_is_late(rig: Rig) -> None:
    device, box, slow = rig
    edges = armed(device, box)
    before = join(read_rows(device.read, 100), 1, 1)
    slow.late = 3
    box.reset(time.monotonic_ns())
    after = join(read_rows(device.read, 100), 1, 1)
    assert slow.late == 0 and (after.quality[-50:, 0] & Quality.DEVICE_RESET).all()
    assert off(before, edges).max() < VOLT and off(after, edges).max() < VOLT
    assert np.abs(after.host - edges[after.number])[-50:].max() < 1e9 / RATE


def test_rows_after_a_pulled_cable_are_those_of_their_triggers_though_the_first_answer_was_late(rig: Rig) -> None:
    device, box, slow = rig
    slow.late = 3
    edges = armed(device, box)
    before = join(read_rows(device.read, 100), 1, 1)
    assert np.abs(before.host - edges[before.number]).max() < 1e9 / RATE
    box.pull_cable()
    while device._link.connected:
        device.read()
    box.plug_cable()
    after = join(read_rows(device.read, 100), 1, 1)
    assert off(before, edges).max() < VOLT and off(after, edges).max() < VOLT


def test_a_restarted_t7_whose_triggers_cannot_be_told_apart_ends_the_run(rig: Rig) -> None:
    device, box, slow = rig
    armed(device, box)
    read_rows(device.read, 50)
    slow.late = 10_000
    box.reset(time.monotonic_ns())
    restarted = 0  # rows that it has given since
    with pytest.raises(DeviceFault, match="too late to tell which of the triggers, 2 ms apart"):
        for _ in range(400):
            restarted += np.count_nonzero(device.read().quality & Quality.DEVICE_RESET)
            time.sleep(0.01)
    assert restarted == 0
