"""QSB and AD4-B through real ptys: counts, cables, power cuts, noise, silence."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers import us_digital_ad4b, us_digital_ad4b_protocol, us_digital_qsb, us_digital_qsb_protocol
from drivers.blocks import join
from drivers.counting import extend
from drivers.serial_port import SerialPort
from drivers.shapes import Block, CounterMode, EdgeSource, Plan, Quality
from inputs import DeviceFault
from sim_backend.protocol import us_digital_ad4b as sim_ad4b
from sim_backend.protocol import us_digital_qsb as sim_qsb
from sim_backend.protocol.serving import Loop, Terminal
from tests.drivers.swing import AMPLITUDE, counts, swing_wires

POLL = Plan(EdgeSource.POLL, 100.0, None)
FASTEST = 2 * np.pi / 4 * AMPLITUDE  # counts/s
PROMPT = 0.012  # s: a question and its answer, where the row is not marked LATE
ASKED = 2 * PROMPT * FASTEST  # counts: one question at the preset, one at the row
STREAMED = 0.008 * FASTEST + ASKED / 2  # held up by 2 ms, counted from the quickest byte; one question at the preset
NOT_NOW = Quality.MISSING | Quality.STALE | Quality.LATE  # a row so marked does not show the count at its time


@pytest.fixture(params=["ask", "stream"])
def qsb(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Any, Any]]:
    where = us_digital_qsb.Config(port=str(tmp_path / "qsb"), reading=request.param, timeout=1.0, patience=3.0)
    yield from pair(us_digital_qsb, sim_qsb, where)


@pytest.fixture
def ad4b(tmp_path: Path) -> Iterator[tuple[Any, Any]]:
    yield from pair(us_digital_ad4b, sim_ad4b, us_digital_ad4b.Config(port=str(tmp_path / "ad4b"), timeout=0.5))


def pair(driver: Any, simulator: Any, where: Any) -> Iterator[tuple[Any, Any]]:
    box = simulator.make("counter", where, swing_wires())
    box.open()
    device = driver.make("counter", where, {})
    yield device, box
    device.close()
    box.close()


def poll_until(device: Any, done: Callable[[Block], object], every: float = 0.005, rows: int = 5000) -> Block:
    """Rows until one is as is awaited."""
    blocks = []
    while not blocks or not done(blocks[-1]):
        assert len(blocks) < rows, "what is awaited does not come"
        blocks.append(device.poll())
        time.sleep(every)
    return join(blocks, 1)


def missing(row: Block) -> bool:
    return bool(row.quality[0, 0] & Quality.MISSING)


def preset(device: Any, count: int) -> int:
    """Sets the register; the ns at which it was done, on a busy machine by a try that was not held up."""
    while True:
        begun = time.monotonic_ns()
        device.preset(0, count)
        done = time.monotonic_ns()
        if done - begun < PROMPT * 1e9:
            return (begun + done) // 2


def poll_for(device: Any, seconds: float, every: float = 0.005) -> Block:
    blocks, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        blocks.append(device.poll())
        time.sleep(every)
    return join(blocks, 1)


def error_of(block: Block, width: int, start: int, count: int) -> np.ndarray:
    """Measured minus true counts of the rows that show their time's, for a register that showed ``count`` at ns ``start``."""
    shown = (block.quality[:, 0] & NOT_NOW) == 0
    assert shown.any()
    measured = extend(block.counts[shown, 0], width, count)
    return measured - count - (counts(0, block.host[shown]) - counts(0, np.array([start]))[0])


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
    box.pull_cable(time.monotonic_ns())
    poll_until(device, missing)
    box.plug_cable()
    poll_until(device, lambda row: not missing(row) and row.quality[0, 0] & Quality.DEVICE_RESET)
    assert (poll_for(device, 0.1).quality & Quality.DEVICE_RESET).all()


def test_qsb_gone_for_good(qsb: tuple[Any, Any]) -> None:
    device, box = qsb
    device.open()
    device.arm(POLL)
    box.pull_cable(time.monotonic_ns())
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
    box = sim_qsb.make("counter", us_digital_qsb.Config(port=str(tmp_path / "qsb")), swing_wires())
    device = us_digital_qsb.make("counter", us_digital_qsb.Config(port=str(tmp_path / "end"), timeout=1.0), {})
    box.open()
    with SlowWire(tmp_path / "qsb", tmp_path / "end") as wire:
        device.open()
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
        device.close()
    box.close()


class SlowWire:
    """A pty that passes on what another one sends ``delay`` s later, in order; when the delay ends, all at once."""

    def __init__(self, behind: Path, path: Path) -> None:
        self.delay = 0.0
        self._far, self._near = SerialPort(str(behind), us_digital_qsb_protocol.BAUD), Terminal("wire", str(path))
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


@pytest.mark.parametrize("delay", [0.01, 0.03, 0.073])
def test_a_streamed_count_that_was_held_up_on_its_way_is_marked(tmp_path: Path, delay: float) -> None:
    """Every poll finds new bytes, and nothing in them tells that they are old."""
    box = sim_qsb.make("counter", us_digital_qsb.Config(port=str(tmp_path / "qsb")), swing_wires())
    device = us_digital_qsb.make("counter", us_digital_qsb.Config(port=str(tmp_path / "end"), timeout=1.0), {})
    box.open()
    with SlowWire(tmp_path / "qsb", tmp_path / "end") as wire:
        device.open()
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
        device.close()
    box.close()


def test_a_stream_that_stays_behind_is_begun_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stale all the while; then missing while its pace is learnt once more; then good again. No row is left out, none unmarked."""
    monkeypatch.setattr(us_digital_qsb, "BEHIND", 500_000_000)
    box = sim_qsb.make("counter", us_digital_qsb.Config(port=str(tmp_path / "qsb")), swing_wires())
    device = us_digital_qsb.make("counter", us_digital_qsb.Config(port=str(tmp_path / "end"), timeout=1.0), {})
    box.open()
    with SlowWire(tmp_path / "qsb", tmp_path / "end") as wire:
        device.open()
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
        device.close()
    box.close()


def test_a_line_that_is_slow_from_the_beginning_is_told(tmp_path: Path) -> None:
    """The stream alone cannot show it."""
    box = sim_qsb.make("counter", us_digital_qsb.Config(port=str(tmp_path / "qsb")), swing_wires())
    device = us_digital_qsb.make("counter", us_digital_qsb.Config(port=str(tmp_path / "end"), timeout=1.0), {})
    box.open()
    with SlowWire(tmp_path / "qsb", tmp_path / "end") as wire:
        device.open()
        assert device.check() == []
        wire.delay = 0.016
        (problem,) = device.check()
        assert "adapter keeps bytes back" in problem
        device.close()
    box.close()


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


def test_a_simulated_line_that_was_held_up_catches_up(tmp_path: Path) -> None:
    """What would have gone out by now goes out at once: later bytes are not late as well."""
    terminal = Terminal("line", str(tmp_path / "line"), 10_000.0)
    terminal.open()
    terminal.write(bytes(1000), time.monotonic_ns() - 1_000_000_000)
    assert not terminal._waiting
    terminal.write(bytes(1000), time.monotonic_ns())
    assert len(terminal._waiting) > 900 and terminal.until_due() <= 0.1
    terminal.close()


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
    """An encoder at 25 million counts a second: 3 wraps in 2 seconds through a 24-bit register read 190 times a second."""
    where = us_digital_ad4b.Config(port=str(tmp_path / "fast"), timeout=0.2)
    wires = swing_wires()
    wires.counts = lambda channel, at: at // 40
    box = sim_ad4b.make("fast", where, wires)
    box.open()
    device = us_digital_ad4b.make("fast", where, {})
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
    box.corrupt = lambda data: data[:-1] if len(data) == us_digital_ad4b_protocol.POSITION_BYTES else data
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
    assert "no answers" in device.check()[0]


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


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    for driver, where in (
        (us_digital_qsb, us_digital_qsb.Config(port=str(tmp_path / "none"))),
        (us_digital_ad4b, us_digital_ad4b.Config(port=str(tmp_path / "none"))),
    ):
        device = driver.make("nobody", where, {})
        with pytest.raises(
            DeviceFault, match=f"^nobody: {tmp_path}/none: No such file or directory; is the .* plugged in"
        ):
            device.open()
        assert device.check()
        device.close()


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
