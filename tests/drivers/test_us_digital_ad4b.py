"""AD4-B through real ptys: counts, cut and foreign answers, power cuts, wraps; and what holds for both devices."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_io import DeviceFault
from drivers import RigContext
from drivers.counting import extend
from drivers.protocols import CounterMode, EdgeSource, Plan, Quality
from drivers.us_digital_ad4b import device as us_digital_ad4b
from drivers.us_digital_ad4b import protocol
from drivers.us_digital_qsb import device as us_digital_qsb
from sim_backend.protocol import us_digital_ad4b as sim_ad4b
from sim_backend.protocol.serving import Terminal
from tests.drivers.swing import counts, swing_wires
from tests.drivers.us_digital_lines import (
    ASKED,
    POLL,
    error_of,
    missing,
    pair,
    poll_for,
    poll_until,
    preset,
)


@pytest.fixture
def ad4b(tmp_path: Path) -> Iterator[tuple[Any, Any]]:
    yield from pair(us_digital_ad4b, sim_ad4b, us_digital_ad4b.Config(port=str(tmp_path / "ad4b"), timeout=0.5))


def test_ad4b_counts(ad4b: tuple[Any, Any]) -> None:
    device, _ = ad4b
    assert device.open().max_rate == 192.0
    assert device.check() == []
    start = preset(device, 0xFFFF00)
    device.arm(POLL)
    block = poll_for(device, 0.3, 0.0)
    assert np.abs(error_of(block, 24, start, 0xFFFF00)).max() < ASKED
    assert not (block.quality & ~np.uint8(Quality.LATE)).any()
    with pytest.raises(DeviceFault, match="9600"):
        device.arm(Plan(EdgeSource.POLL, 200.0, None))


def test_24_bits_wrap_at_speed(tmp_path: Path) -> None:
    """An encoder at 25 million counts per second.

    3 wraps in 2 seconds through a 24-bit register read 190 times per second.
    """
    where = us_digital_ad4b.Config(port=str(tmp_path / "fast"), timeout=0.2)
    wires = swing_wires()
    wires.counts = lambda channel, at: at // 40
    box = sim_ad4b.make("fast", where, wires)
    box.open()
    device = us_digital_ad4b.make("fast", where, RigContext())
    device.open()
    device.arm(POLL)
    block = poll_for(device, 1.6, 0.0)
    assert not (block.quality & Quality.MISSING).any()
    turned = extend(block.counts[:, 0], 24, int(block.counts[0, 0]))
    assert turned[-1] - turned[0] > 2 * (1 << 24)
    speed = np.diff(turned) / np.diff(block.host) * 1e9
    assert np.median(speed) == pytest.approx(2.5e7, rel=0.02)
    device.close()
    box.close()


def test_ad4b_truncated_answer_is_no_position(ad4b: tuple[Any, Any]) -> None:
    device, box = ad4b
    device.open()
    start = preset(device, 0)
    device.arm(POLL)
    poll_for(device, 0.05)
    box.corrupt = lambda data: data[:-1] if len(data) == protocol.POSITION_BYTES else data
    assert missing(device.poll())
    box.corrupt = lambda data: data
    poll_until(device, lambda row: not missing(row))
    assert np.abs(error_of(poll_for(device, 0.2, 0.0), 24, start, 0)).max() < ASKED


def test_ad4b_bytes_of_another_answer_are_not_taken(ad4b: tuple[Any, Any]) -> None:
    device, box = ad4b
    device.open()
    device.arm(POLL)
    box._terminal.write(b"\x11\x22\x33\x44", time.monotonic_ns())
    while device._port._alive().in_waiting < 4:
        time.sleep(0.001)
    block = device.poll()
    assert not missing(block) and block.counts[0, 0] != 0x332211
    assert "not answers" in device.check()[0]


def test_ad4b_power_cut_is_marked(ad4b: tuple[Any, Any]) -> None:
    device, box = ad4b
    device.open()
    device.arm(POLL)
    poll_for(device, 0.05)
    box.pull_cable()
    box.reset(time.monotonic_ns())
    poll_until(device, missing)
    box.plug_cable()
    block = poll_until(device, lambda row: not missing(row))
    assert block.quality[-1, 0] & Quality.DEVICE_RESET


def test_a_row_after_reopening_has_its_own_time(ad4b: tuple[Any, Any]) -> None:
    """Opening the port, draining and pinging take longer than a row: its time is that of its own question."""
    device, box = ad4b
    device.open()
    start = preset(device, 0)
    device.arm(POLL)
    for _ in range(20):  # on a busy machine the row itself may be late
        box.corrupt = lambda data: b""
        poll_until(device, missing)
        box.corrupt = lambda data: data
        back = poll_until(device, lambda row: not missing(row))
        if not back.quality[-1, 0] & Quality.LATE:
            break
    assert np.abs(error_of(back, 24, start, 0)).max() < ASKED


def test_modes(ad4b: tuple[Any, Any]) -> None:
    device, _ = ad4b
    device.open()
    device.configure(0, CounterMode.X1)
    device.arm(POLL)
    block = poll_for(device, 0.3, 0.0)
    ends = np.flatnonzero(block.quality[:, 0] == 0)[[0, -1]]
    moved = np.diff(extend(block.counts[ends, 0], 24, 0))[0]
    truth = np.diff(counts(0, block.host[ends]))[0] / 4
    assert abs(moved - truth) < ASKED / 4


def test_a_simulated_line_that_was_held_up_catches_up(tmp_path: Path) -> None:
    """What would have gone out by now goes out at once: later bytes are not late as well."""
    terminal = Terminal("line", str(tmp_path / "line"), 10_000.0)
    terminal.open()
    terminal.write(bytes(1000), time.monotonic_ns() - 1_000_000_000)
    assert not terminal._waiting
    terminal.write(bytes(1000), time.monotonic_ns())
    assert len(terminal._waiting) > 900 and terminal.until_due() <= 0.1
    terminal.close()


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    for driver, where in (
        (us_digital_qsb, us_digital_qsb.Config(port=str(tmp_path / "none"))),
        (us_digital_ad4b, us_digital_ad4b.Config(port=str(tmp_path / "none"))),
    ):
        device = driver.make("nobody", where, RigContext())
        with pytest.raises(
            DeviceFault, match=f"^nobody: {tmp_path}/none: No such file or directory; is the .* plugged in"
        ):
            device.open()
        assert device.check()
        device.close()
