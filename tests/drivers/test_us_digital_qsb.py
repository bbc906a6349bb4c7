"""QSB through real ptys: counts, cables, power cuts, noise, silence, lines that hold bytes back."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_io import DeviceFault
from drivers import RigContext
from drivers.blocks import join
from drivers.protocols import EdgeSource, Plan, Quality
from drivers.serial_port import SerialPort
from drivers.us_digital_qsb import device as us_digital_qsb
from drivers.us_digital_qsb import protocol
from sim_backend.protocol import us_digital_qsb as sim_qsb
from sim_backend.protocol.serving import Loop, Terminal
from tests.drivers.swing import swing_wires
from tests.drivers.us_digital_lines import (
    ASKED,
    NOT_NOW,
    POLL,
    STREAMED,
    error_of,
    missing,
    pair,
    poll_for,
    poll_until,
    preset,
)


@pytest.fixture(params=["ask", "stream"])
def qsb(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Any, Any]]:
    where = us_digital_qsb.Config(port=str(tmp_path / "qsb"), reading=request.param, timeout=1.0, patience=3.0)
    yield from pair(us_digital_qsb, sim_qsb, where)


def test_qsb_counts(qsb: tuple[Any, Any]) -> None:
    device, _ = qsb
    assert device.open().maker == "US Digital"
    assert device.check() == []
    start = preset(device, 70_000)
    device.arm(POLL)
    block = poll_for(device, 0.3)
    slack = ASKED if device.config.reading == "ask" else STREAMED
    assert np.abs(error_of(block, 32, start, 70_000)).max() < slack
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
    box.pull_cable()
    poll_until(device, missing)
    box.plug_cable()
    poll_until(device, lambda row: not missing(row) and row.quality[0, 0] & Quality.DEVICE_RESET)
    assert (poll_for(device, 0.1).quality & Quality.DEVICE_RESET).all()


def test_qsb_gone_for_good(qsb: tuple[Any, Any]) -> None:
    device, box = qsb
    device.open()
    device.arm(POLL)
    box.pull_cable()
    with pytest.raises(DeviceFault, match="plugged in"):
        poll_for(device, 5.0, 0.02)


class Noise:
    """Loses every two-hundredth byte."""

    def __init__(self) -> None:
        self.lost, self._random = 0, np.random.default_rng(3)

    def __call__(self, data: bytes) -> bytes:
        kept = bytes(b for b in data if self._random.random() > 0.005)
        self.lost += len(data) - len(kept)
        return kept


@pytest.mark.parametrize("reading", ["ask", "stream"])
def test_qsb_noise_costs_rows_not_truth(tmp_path: Path, reading: str) -> None:
    where = us_digital_qsb.Config(port=str(tmp_path / "qsb"), reading=reading, timeout=0.1, patience=60.0)
    for device, box in pair(us_digital_qsb, sim_qsb, where):
        device.open()
        start = preset(device, 0)
        device.arm(POLL)
        box.corrupt = noise = Noise()
        blocks = []
        while len(blocks) < 40 or noise.lost < 3:
            blocks.append(poll_until(device, lambda row: not row.quality[0, 0] & NOT_NOW))
        box.corrupt = lambda data: data
        slack = ASKED if reading == "ask" else STREAMED
        assert np.abs(error_of(join(blocks, 1), 32, start, 0)).max() < slack


def test_qsb_an_answer_that_comes_too_late_is_not_the_next_rows(tmp_path: Path) -> None:
    """The reply to a question that was given up lies in the line when the next one is asked: it is not its answer."""
    where = us_digital_qsb.Config(port=str(tmp_path / "qsb"), reading="ask", timeout=0.05)
    for device, box in pair(us_digital_qsb, sim_qsb, where):
        device.open()
        start = preset(device, 0)
        device.arm(POLL)
        held: list[bytes] = []
        box.corrupt = lambda data: held.append(data) or b""  # noqa: B023
        assert missing(device.poll())
        box.corrupt = lambda data: data
        assert held
        box._terminal.write(held[0], time.monotonic_ns())
        poll_until(device, lambda row: not missing(row))
        assert np.abs(error_of(poll_for(device, 0.2), 32, start, 0)).max() < ASKED


def test_a_stream_that_falls_silent_is_stale_then_missing(tmp_path: Path) -> None:
    where = us_digital_qsb.Config(port=str(tmp_path / "qsb"), timeout=1.0)
    for device, box in pair(us_digital_qsb, sim_qsb, where):
        device.open()
        device.arm(POLL)
        poll_for(device, 0.05)
        box.mute = True
        silent = poll_until(device, missing)
        assert (silent.quality[-2] & Quality.STALE).all()


def test_a_host_that_was_away_takes_no_old_count_for_a_new_one(tmp_path: Path) -> None:
    where = us_digital_qsb.Config(port=str(tmp_path / "qsb"), timeout=2.0)
    for device, _ in pair(us_digital_qsb, sim_qsb, where):
        device.open()
        start = preset(device, 0)
        device.arm(POLL)
        time.sleep(0.5)  # 11 kB: more than the kernel gives at once
        rows = poll_until(device, lambda row: not row.quality[0, 0])
        assert np.abs(error_of(rows, 32, start, 0)).max() < STREAMED


def test_a_host_that_was_away_does_not_forgive_a_slow_line(tmp_path: Path) -> None:
    """All that has piled up is counted, so that what is still under way is known afterwards as before."""
    with behind_slow_wire(tmp_path) as (device, wire):
        start = preset(device, 0)
        device.arm(POLL)
        first = poll_until(device, lambda row: not row.quality[0, 0])
        wire.delay = 0.05
        poll_for(device, 0.2)
        time.sleep(0.3)
        held = poll_for(device, 0.3)
        assert (held.quality[:, 0] & NOT_NOW).all()
        wire.delay = 0.0
        shown = join([first, held, poll_until(device, lambda row: not row.quality[0, 0])], 1)
        assert np.abs(error_of(shown, 32, start, 0)).max() < STREAMED


class SlowWire:
    """A pty that passes on what another one sends ``delay`` s later, in order; when the delay ends, all at once."""

    def __init__(self, behind: Path, path: Path) -> None:
        self.delay = 0.0
        self._far, self._near = SerialPort(str(behind), protocol.BAUD), Terminal("wire", str(path))
        self._on_the_way: deque[tuple[int, bytes]] = deque()
        self._loop = Loop(self._step, lambda: [self._near.fileno(), self._far._alive().fileno()], 0.001)

    def __enter__(self) -> SlowWire:
        self._far.open()
        self._near.open()
        self._loop.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.stop()
        self._near.close()
        self._far.close()

    def _step(self, now: int) -> None:
        if asked := self._near.read():
            self._far.write(asked)
        if came := self._far.read():
            self._on_the_way.append((now, came))
        while self._on_the_way and self._on_the_way[0][0] <= now - self.delay * 1e9:
            self._near.write(self._on_the_way.popleft()[1], now)


@contextmanager
def behind_slow_wire(folder: Path) -> Iterator[tuple[Any, SlowWire]]:
    """An open QSB that streams, and the wire that delays what it sends."""
    box = sim_qsb.make("counter", us_digital_qsb.Config(port=str(folder / "qsb")), swing_wires())
    box.open()
    where = us_digital_qsb.Config(port=str(folder / "end"), timeout=1.0)
    device = us_digital_qsb.make("counter", where, RigContext())
    with SlowWire(folder / "qsb", folder / "end") as wire:
        device.open()
        yield device, wire
        device.close()
    box.close()


@pytest.mark.parametrize("delay", [0.01, 0.03, 0.073])
def test_a_streamed_count_that_was_held_up_on_its_way_is_marked(tmp_path: Path, delay: float) -> None:
    """Every poll finds new bytes, and nothing in them shows that they are old."""
    with behind_slow_wire(tmp_path) as (device, wire):
        start = preset(device, 0)
        device.arm(POLL)
        for _ in range(3):
            first = poll_until(device, lambda row: not row.quality[0, 0])
            wire.delay = delay
            begun = time.monotonic()
            held = poll_for(device, 0.3)
            late = held.host > (begun + delay) * 1e9
            assert late.sum() > 5 and (held.quality[late] & Quality.STALE).all()
            wire.delay = 0.0
            shown = join([first, held, poll_until(device, lambda row: not row.quality[0, 0])], 1)
            assert np.abs(error_of(shown, 32, start, 0)).max() < STREAMED


def test_a_stream_that_stays_behind_is_begun_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stale all the while; then missing while its pace is learnt once more; then good again.

    No row is left out, none unmarked.
    """
    monkeypatch.setattr(us_digital_qsb, "BEHIND", 500_000_000)
    with behind_slow_wire(tmp_path) as (device, wire):
        start = preset(device, 0)
        device.arm(POLL)
        poll_until(device, lambda row: not row.quality[0, 0])
        wire.delay = 0.03
        behind = poll_until(device, missing)
        wire.delay = 0.0
        anew = poll_until(device, lambda row: not row.quality[0, 0])
        assert np.count_nonzero(behind.quality[:, 0] & NOT_NOW) > 5
        gone = (anew.quality[:, 0] & Quality.MISSING) != 0
        assert np.count_nonzero(np.diff(gone.astype(int)) > 0) < 2, "begun anew again and again"
        assert not (anew.quality & Quality.DEVICE_RESET).any()
        again = join([anew, poll_for(device, 0.3)], 1)
        assert np.abs(error_of(again, 32, start, 0)).max() < STREAMED


def test_a_line_that_is_slow_from_the_beginning_is_told(tmp_path: Path) -> None:
    """The stream alone cannot show it."""
    with behind_slow_wire(tmp_path) as (device, wire):
        assert device.check() == []
        wire.delay = 0.016
        (problem,) = device.check()
        assert "adapter buffers bytes" in problem
