"""CiA 406 encoders that answer the SYNCs of a node, under arbitrary delays, on python-can's virtual bus."""

from __future__ import annotations

import struct
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import DeviceFault
from drivers import RigContext
from drivers.blocks import join
from drivers.cia406 import device as cia406
from drivers.cia406 import protocol as cia
from drivers.cia406.protocol import Heard, Round
from drivers.protocols import Block, EdgeSource, Latched, Plan, Polled, Quality, Reconnecting
from sim_backend.protocol import cia406 as simulator
from tests.drivers.swing import counts, swing_wires

RATE = 200.0
TIMER = Plan(EdgeSource.TIMER, RATE, None)
PERIOD = 1_000_000  # ns
USUAL = 0.1  # of a period


@pytest.fixture
def encoders() -> Iterator[tuple[Any, Any]]:
    where = cia406.Config(nodes=(1, 2, 5), bits=25, sync=2, patience=5.0, interface="virtual", channel=uuid.uuid4().hex)
    box = simulator.make("box", where, swing_wires())
    box.open()
    device = cia406.make("device", where, RigContext())
    yield device, box
    device.close()
    box.close()


def rows_until(device: Any, done: Callable[[Block], object]) -> Block:
    """Rows until one block is as is awaited."""
    blocks: list[Block] = []
    end = time.monotonic() + 20
    while not blocks or not done(blocks[-1]):
        assert time.monotonic() < end, "what is awaited does not come"
        time.sleep(0.01)
        if len(block := device.read()):
            blocks.append(block)
    return join(blocks, 3)


def rows_for(device: Any, seconds: float) -> Block:
    end = time.monotonic() + seconds
    return rows_until(device, lambda _: time.monotonic() > end)


def assert_true(block: Block, reach: float = 400.0) -> None:
    """Good values are those of their SYNC's time; the simulated node latches within ``reach`` counts of it."""
    truth = np.stack([counts(c, block.host) for c in range(3)], axis=1) + (1 << 24)
    good = (block.quality & ~np.uint8(Quality.DEVICE_RESET)) == 0
    assert good.any() and np.median(np.abs(block.counts - truth)[good]) < 100
    assert (np.abs(block.counts - truth)[good] < reach).mean() > 0.7  # a busy machine stamps a SYNC late now and then


def assert_gap(block: Block, least: float) -> None:
    """One jump of the numbers, by the time that has passed, which is more than ``least`` s."""
    steps = np.diff(block.number)
    (at,) = np.flatnonzero(steps > 1)
    seconds = (block.host[at + 1] - block.host[at]) * 1e-9
    assert seconds > least and steps[at] == pytest.approx(seconds * RATE, abs=0.5 + 0.1 * steps[at])


def test_every_sync_of_the_node_is_a_row(encoders: tuple[Any, Any]) -> None:
    device, _ = encoders
    assert isinstance(device, Latched | Reconnecting) and not isinstance(device, Polled)
    assert device.open().details["sync"] == "2" and device.check() == []
    device.arm(TIMER)
    block = rows_for(device, 0.5)
    assert np.array_equal(block.number, np.arange(len(block)))
    assert np.median(np.diff(block.host)) == pytest.approx(1e9 / RATE, rel=0.1)
    assert_true(block)
    # a SYNC may come before each of these reads
    edges, rest = device.read_edges(), device.read()
    rows = join([block, rest], 3) if len(rest) else block
    assert len(edges) >= len(block) and np.array_equal(edges.number, rows.number[: len(edges)])
    device.disarm()
    time.sleep(0.05)
    device._frames.take()
    time.sleep(0.05)
    assert not device._frames.take()  # no SYNC any more


def test_somebody_else_makes_the_syncs_anyway(encoders: tuple[Any, Any]) -> None:
    _, box = encoders
    where = box.config.model_copy(update={"sync": "bus"})
    device = cia406.make("listener", where, RigContext())
    device.open()
    with pytest.raises(DeviceFault, match="0 SYNCs were heard in .* who makes them"):
        device.arm(TIMER)
    ended = threading.Event()

    def controller() -> None:
        while not ended.wait(1 / RATE):
            device._bus.send(cia.SYNC, b"")
            box.bus.send(cia.SYNC, b"")  # a virtual bus gives nobody his own frame

    thread = threading.Thread(target=controller)
    thread.start()
    try:
        with pytest.raises(DeviceFault, match="the rig expects 800"):
            device.arm(Plan(EdgeSource.TIMER, 800.0, None))
        device.arm(Plan(EdgeSource.TIMER, RATE, None))
        assert_true(rows_for(device, 0.3), 5000.0)  # two sendings, one after the other
    finally:
        ended.set()
        thread.join()
        device.close()


def test_what_it_cannot_do(encoders: tuple[Any, Any]) -> None:
    device, _ = encoders
    device.open()
    with pytest.raises(DeviceFault, match="trigger source poll must be timer"):
        device.arm(Plan(EdgeSource.POLL, 100.0, None))
    with pytest.raises(DeviceFault, match="possible with 3 encoders"):
        device.arm(Plan(EdgeSource.TIMER, 5000.0, None))


def test_a_node_that_cannot_make_syncs_is_told(encoders: tuple[Any, Any]) -> None:
    device, box = encoders
    device.open()
    del box.encoders[2].node.object_dictionary[cia.SYNC_IDENTIFIER]
    with pytest.raises(DeviceFault, match="node 2, object 1005h: .* exist"):
        device.arm(TIMER)


def test_an_encoder_that_falls_silent_is_missing_alone(encoders: tuple[Any, Any]) -> None:
    device, box = encoders
    device.open()
    device.arm(TIMER)
    box.encoders[1].mute = True
    block = rows_until(device, lambda b: b.quality[-1, 0] & Quality.MISSING)
    block = rows_for(device, 0.2)
    assert (block.quality[:, 0] == Quality.MISSING).all() and not (block.quality[:, 1:] & Quality.MISSING).all(
        axis=1
    ).any()
    box.encoders[1].mute = False
    assert_true(rows_until(device, lambda b: not b.quality[-1].any()))


def test_the_node_that_makes_the_syncs_restarts(encoders: tuple[Any, Any]) -> None:
    """It is set up again and goes on; the SYNCs that it did not make leave a gap in the numbers."""
    device, box = encoders
    device.open()
    device.arm(TIMER)
    before = rows_for(device, 0.2)
    box.restart(2)
    after = rows_until(device, lambda b: b.quality[-1].tolist() == [0, Quality.DEVICE_RESET, 0])
    assert_true(after)
    assert_gap(join([before, after], 3), 0.0)


def test_bus_off_leaves_a_gap_in_the_numbers(encoders: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    import can

    device, _ = encoders
    device.open()
    device.arm(TIMER)
    before = rows_for(device, 0.2)

    def off(timeout: float | None = None) -> None:
        raise can.CanOperationError("bus off")

    monkeypatch.setattr(device._bus._bus, "recv", off)  # reopening makes a new one
    device.read()
    assert device.seeking
    after = rows_until(device, lambda b: not b.quality[-1].any())
    assert not device.seeking
    assert_gap(join([before, after], 3), 0.05)
    assert_true(after)


def played(delays: list[float | None]) -> list[Round]:
    """Rounds of one node whose k-th answer, k, comes so many periods after SYNC k (None: never)."""
    frames = [(k * PERIOD, cia.SYNC, b"") for k in range(len(delays) + 3)]
    answers = [(k, delay) for k, delay in enumerate(delays) if delay is not None]
    frames += [(int((k + delay) * PERIOD), cia.TPDO1 + 3, struct.pack("<I", k)) for k, delay in answers]
    heard = Heard((3,))
    return [r for at, i, data in sorted(frames) if (r := heard.take(i, data, at)) is not None]


in_time, late = st.floats(0.05, 0.1), st.floats(1.25, 1.95)


@given(delays=st.lists(st.one_of(in_time, in_time, late, st.none()), max_size=40))
@settings(max_examples=300)
def test_no_good_value_of_another_sync(delays: list[float | None]) -> None:
    rounds = played([USUAL, USUAL, *delays])
    assert len(rounds) == len(delays) + 4
    for k, one in enumerate(rounds):
        assert one.at == k * PERIOD
        assert one.quality[0] is not Quality.GOOD or one.values[0] == k


@given(delays=st.lists(st.one_of(in_time, in_time, in_time, st.none()), max_size=40))
@settings(max_examples=100)
def test_a_lost_answer_costs_its_own_row_and_no_other(delays: list[float | None]) -> None:
    for one, delay in zip(played([USUAL, *delays]), [USUAL, *delays]):
        assert one.quality == [Quality.MISSING if delay is None else Quality.GOOD]


@given(
    frames=st.lists(st.tuples(st.sampled_from([cia.SYNC, cia.TPDO1 + 3, cia.TPDO1 + 4, 0x7FF]), st.binary(max_size=8)))
)
@settings(max_examples=100)
def test_frames_of_another_form_are_no_answers(frames: list[tuple[int, bytes]]) -> None:
    heard, since = Heard((3,)), None
    for at, (identifier, data) in enumerate(frames):
        ended = heard.take(identifier, data, at)
        if ended is not None:
            assert since is not None
            assert (ended.quality[0] is Quality.MISSING) == (not since)
            assert not since or ended.values == [since[-1]]
        if identifier == cia.SYNC:
            since = []
        elif identifier == cia.TPDO1 + 3 and len(data) == 4 and since is not None:
            since.append(int.from_bytes(data, "little"))
