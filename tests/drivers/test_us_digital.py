"""QSB and AD4-B through real ptys: counts, cables, power cuts, noise, silence."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers import us_digital_ad4b, us_digital_ad4b_protocol, us_digital_qsb
from drivers.blocks import join
from drivers.counting import extend
from drivers.shapes import Block, CounterMode, EdgeSource, Plan, Quality
from inputs import DeviceFault
from sim_backend.protocol import us_digital_ad4b as sim_ad4b
from sim_backend.protocol import us_digital_qsb as sim_qsb
from tests.drivers.swing import counts, swing_wires

POLL = Plan(EdgeSource.POLL, 100.0, None)
SLACK = 1500  # counts: 50 ms of the fastest motion, what a busy machine may be late by


@pytest.fixture(params=["ask", "stream"])
def qsb(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Any, Any]]:
    where = us_digital_qsb.Config(port=str(tmp_path / "qsb"), reading=request.param, timeout=0.1, patience=2.0)
    yield from pair(us_digital_qsb, sim_qsb, where)


@pytest.fixture
def ad4b(tmp_path: Path) -> Iterator[tuple[Any, Any]]:
    yield from pair(us_digital_ad4b, sim_ad4b, us_digital_ad4b.Config(port=str(tmp_path / "ad4b"), patience=2.0))


def pair(driver: Any, simulator: Any, where: Any) -> Iterator[tuple[Any, Any]]:
    box = simulator.make("counter", where, swing_wires())
    box.open()
    device = driver.make("counter", where, {})
    yield device, box
    device.close()
    box.close()


def poll_for(device: Any, seconds: float, every: float = 0.005) -> Block:
    blocks, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        blocks.append(device.poll())
        time.sleep(every)
    return join(blocks, 1)


def error_of(block: Block, width: int, start: int, count: int) -> np.ndarray:
    """Measured minus true counts, for a register that showed ``count`` at ns ``start``."""
    measured = extend(block.counts[:, 0], width, count)
    return measured - count - (counts(0, block.host) - counts(0, np.array([start]))[0])


def test_qsb_counts(qsb: tuple[Any, Any]) -> None:
    device, _ = qsb
    assert device.open().maker == "US Digital"
    assert device.check() == []
    device.preset(0, 70_000)
    start = time.monotonic_ns()
    device.arm(POLL)
    block = poll_for(device, 0.3)
    assert np.abs(error_of(block, 32, start, 70_000)).max() < SLACK
    assert not (block.quality & ~np.uint8(Quality.STALE | Quality.LATE)).any()


def test_qsb_says_what_it_cannot_do(qsb: tuple[Any, Any]) -> None:
    device, _ = qsb
    device.open()
    with pytest.raises(DeviceFault, match="possible"):
        device.arm(Plan(EdgeSource.TRACKER, 2000.0, None))
    with pytest.raises(DeviceFault, match="index"):
        device.index_enable(0)


def test_qsb_unplugged_and_plugged_in_again(qsb: tuple[Any, Any]) -> None:
    """USB is its power: behind the gap its count begins anew, and every row says so."""
    device, box = qsb
    device.open()
    device.arm(POLL)
    assert not (poll_for(device, 0.1).quality & Quality.MISSING).any()
    box.pull_cable(time.monotonic_ns())
    assert (poll_for(device, 0.3).quality[-1] & Quality.MISSING).all()
    box.plug_cable()
    block = poll_for(device, 0.8)
    back = (block.quality[:, 0] & Quality.MISSING) == 0
    assert back.any() and back[-1]
    assert (block.quality[back, 0] & Quality.DEVICE_RESET).all()


def test_qsb_gone_for_good(qsb: tuple[Any, Any]) -> None:
    device, box = qsb
    device.open()
    device.arm(POLL)
    box.pull_cable(time.monotonic_ns())
    with pytest.raises(DeviceFault, match="plugged in"):
        poll_for(device, 5.0, 0.02)


def test_qsb_noise_costs_rows_not_truth(qsb: tuple[Any, Any]) -> None:
    """Every fiftieth byte is lost."""
    device, box = qsb
    device.open()
    device.preset(0, 0)
    start = time.monotonic_ns()
    device.arm(POLL)
    random = np.random.default_rng(3)
    box.corrupt = lambda data: bytes(b for b in data if random.random() > 0.02)
    block = poll_for(device, 0.6)
    box.corrupt = lambda data: data
    good = (block.quality[:, 0] & (Quality.MISSING | Quality.STALE)) == 0
    assert good.any()
    kept = Block(*(getattr(block, name)[good] for name in ("number", "host", "tick", "quality", "counts")))
    assert np.abs(error_of(kept, 32, start, 0)).max() < SLACK


def test_a_stream_that_falls_silent_is_stale_then_missing(tmp_path: Path) -> None:
    where = us_digital_qsb.Config(port=str(tmp_path / "qsb"), timeout=0.2)
    for device, box in pair(us_digital_qsb, sim_qsb, where):
        device.open()
        device.arm(POLL)
        poll_for(device, 0.05)
        box.mute = True
        time.sleep(0.05)
        device.poll()  # takes what had still come
        time.sleep(0.05)
        assert device.poll().quality[0, 0] & Quality.STALE
        time.sleep(0.3)
        assert device.poll().quality[0, 0] & Quality.MISSING


def test_ad4b_counts(ad4b: tuple[Any, Any]) -> None:
    device, _ = ad4b
    assert device.open().max_rate == 192.0
    assert device.check() == []
    device.preset(0, 0xFFFF00)
    start = time.monotonic_ns()
    device.arm(POLL)
    block = poll_for(device, 0.3, 0.0)
    assert np.abs(error_of(block, 24, start, 0xFFFF00)).max() < SLACK
    assert not (block.quality & ~np.uint8(Quality.LATE)).any()
    with pytest.raises(DeviceFault, match="9600"):
        device.arm(Plan(EdgeSource.POLL, 200.0, None))


def test_24_bits_wrap_at_speed(tmp_path: Path) -> None:
    """An encoder at 100 million counts a second: 6 wraps a second through a 24-bit register read 100 times a second."""
    where = us_digital_ad4b.Config(port=str(tmp_path / "fast"))
    wires = swing_wires()
    wires.counts = lambda channel, at: at // 10
    box = sim_ad4b.make("fast", where, wires)
    box.open()
    device = us_digital_ad4b.make("fast", where, {})
    device.open()
    device.arm(POLL)
    block = poll_for(device, 0.5, 0.0)
    turned = extend(block.counts[:, 0], 24, int(block.counts[0, 0]))
    assert turned[-1] - turned[0] > 2 * (1 << 24)
    speed = np.diff(turned) / np.diff(block.host) * 1e9
    assert np.median(speed) == pytest.approx(1e8, rel=0.02)
    device.close()
    box.close()


def test_ad4b_truncated_answer_is_no_position(ad4b: tuple[Any, Any]) -> None:
    device, box = ad4b
    device.open()
    device.preset(0, 0)
    start = time.monotonic_ns()
    device.arm(POLL)
    poll_for(device, 0.05)
    box.corrupt = lambda data: data[:-1] if len(data) == us_digital_ad4b_protocol.POSITION_BYTES else data
    assert device.poll().quality[0, 0] & Quality.MISSING
    box.corrupt = lambda data: data
    block = poll_for(device, 0.5, 0.0)
    good = (block.quality[:, 0] & Quality.MISSING) == 0
    assert good[-1]
    kept = Block(*(getattr(block, name)[good] for name in ("number", "host", "tick", "quality", "counts")))
    assert np.abs(error_of(kept, 24, start, 0)).max() < SLACK


def test_ad4b_bytes_of_another_answer_are_not_taken(ad4b: tuple[Any, Any]) -> None:
    device, box = ad4b
    device.open()
    device.arm(POLL)
    box._terminal.write(b"\x11\x22\x33\x44", time.monotonic_ns())
    time.sleep(0.02)
    block = device.poll()
    assert not block.quality[0, 0] & Quality.MISSING and block.counts[0, 0] != 0x332211
    assert "no answers" in device.check()[0]


def test_ad4b_power_cut_is_marked(ad4b: tuple[Any, Any]) -> None:
    device, box = ad4b
    device.open()
    device.arm(POLL)
    poll_for(device, 0.05)
    box.pull_cable()
    box.reset(time.monotonic_ns())
    assert (poll_for(device, 0.2).quality[-1] & Quality.MISSING).all()
    box.plug_cable()
    block = poll_for(device, 0.8)
    assert block.quality[-1, 0] & Quality.DEVICE_RESET


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    for driver, where in (
        (us_digital_qsb, us_digital_qsb.Config(port=str(tmp_path / "none"))),
        (us_digital_ad4b, us_digital_ad4b.Config(port=str(tmp_path / "none"))),
    ):
        device = driver.make("nobody", where, {})
        with pytest.raises(DeviceFault, match="plugged in"):
            device.open()
        assert device.check()
        device.close()


def test_modes(ad4b: tuple[Any, Any]) -> None:
    device, _ = ad4b
    device.open()
    device.configure(0, CounterMode.X1)
    device.arm(POLL)
    block = poll_for(device, 0.3, 0.0)
    moved = np.diff(extend(block.counts[[0, -1], 0], 24, 0))[0]
    truth = np.diff(counts(0, block.host[[0, -1]]))[0] / 4
    assert abs(moved - truth) < SLACK / 4
