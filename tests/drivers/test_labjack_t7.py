"""The T7's driver against a T7 on loopback: what it measures, and every way in which it can be disturbed."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from arm_io import DeviceFault
from drivers import RigContext, modbus_tcp
from drivers.blocks import join
from drivers.counting import extend
from drivers.labjack_t7 import device as driver
from drivers.labjack_t7 import protocol as t7
from drivers.labjack_t7.link import LinkLost
from drivers.protocols import Block, CounterMode, EdgeSource, Plan, Quality
from sim_backend.protocol import labjack_t7 as simulator
from sim_backend.protocol.wires import Wires
from tests.drivers.swing import AMPLITUDE, counts, read_rows, swing_wires, volts
from tests.ports import free_port

TIMER = EdgeSource.TIMER
FASTEST = 2 * np.pi * 0.75 * AMPLITUDE  # counts/s of channel 2
STEEPEST = 2 * np.pi * 2.0 * 3.0  # V/s of input 7


def config(**options: object) -> driver.Config:
    fixed = {"host": "127.0.0.1", "port": free_port(), "stream_port": free_port(), "timeout": 0.3, "patience": 2.0}
    return driver.Config.model_validate(fixed | options)


@pytest.fixture
def rig() -> Iterator[tuple[driver.LabJackT7, simulator.SimulatedT7, Wires]]:
    wires = swing_wires()
    wires.switched = []
    wires.line = lambda name, high, at: wires.switched.append((name, high))
    where = config()
    box = simulator.make("t7", where, wires)
    box.open()
    device = driver.make("t7", where, RigContext())
    yield device, box, wires
    device.close()
    box.close()


def all_columns(device: driver.LabJackT7, blocks: list[Block]) -> Block:
    return join(blocks, len(device.config.counters), len(device.config.inputs))


def counts_off(block: Block, box: simulator.SimulatedT7) -> int:
    """Largest difference of the counts, with those at configuration time added back, from the true ones."""
    pairs = zip((box._zero[line] for line in (0, 2, 6)), block.counts.T, strict=True)
    return max(np.abs(extend(of, 32, 0) + zero - counts(c, block.host)).max() for c, (zero, of) in enumerate(pairs))


def stamped_within(device: driver.LabJackT7) -> float:
    """s by which rows so far may have been stamped too early or late.

    Half a round trip, of which a busy machine makes long ones.
    """
    return 0.5e-9 * max(trip for _, _, trip in device._timer._ticks._readings)


def test_counts_and_volts_are_those_on_the_wires(rig) -> None:
    device, box, _ = rig
    identity = device.open()
    assert (identity.maker, identity.model, identity.max_rate) == ("LabJack", "T7", 6250.0)
    assert device.check() == []
    device.arm(Plan(TIMER, 2000.0, 800))
    block = all_columns(device, read_rows(device.read, 800))
    assert block.number.tolist() == list(range(len(block)))
    off = stamped_within(device)
    assert (np.diff(block.tick) == t7.CORE_TIMER_HZ // 2000).all()
    # A quicker reading of its clock moves the stamps of the rows that follow, by no more than the earlier one was off.
    steps = np.diff(block.host) - 500_000
    assert np.median(np.abs(steps)) <= 2 and np.abs(steps).max() < 2 + 2e9 * off
    assert counts_off(block, box) < 5 + FASTEST * off
    assert (
        np.abs(block.volts - np.stack([volts(k, block.host) for k in range(8)], axis=1)).max() < 0.002 + STEEPEST * off
    )
    assert not block.quality.any()


def test_the_trigger_line_makes_the_rows_one_an_edge(rig) -> None:
    device, _, wires = rig
    device.open()
    device.arm(Plan(EdgeSource.TRACKER, 1000.0, 300))
    time.sleep(0.05)
    assert len(device.read()) == 0
    edges = np.array([], np.int64)
    blocks, marks = [], []
    while len(edges) < 300:
        now = time.monotonic_ns()
        new = now - np.arange(20)[::-1] * 50_000
        wires.trigger.add(new[: 300 - len(edges)])
        edges = np.concatenate([edges, new[: 300 - len(edges)]])
        blocks.append(device.read())
        time.sleep(0.005)
    blocks += read_rows(device.read, 300 - sum(map(len, blocks)))
    block = all_columns(device, blocks)
    marks = join([device.read_edges()])
    assert block.number.tolist() == list(range(300)) == marks.number.tolist()
    intervals = np.diff(block.tick) / t7.CORE_TIMER_HZ * 1e9
    assert np.abs(intervals - np.diff(edges)).max() < 50  # one tick is 25 ns


def test_outputs_and_their_safe_state(rig) -> None:
    device, box, wires = rig
    device.open()
    device.write_line("start", True)
    device.write_volts(1, 2.5)
    assert wires.switched[-1] == ("start", True) and box.dacs == [0.0, 2.5]
    device.safe()
    assert wires.switched[-1] == ("start", False) and box.dacs == [0.0, 0.0]
    for wrong in (lambda: device.write_line("brake", True), lambda: device.write_volts(0, -1.0)):
        with pytest.raises(DeviceFault):
            wrong()


def test_preset_and_what_the_t7_cannot_do(rig) -> None:
    device, box, _ = rig
    device.open()
    device.preset(1, 5000)
    reference = counts(1, np.array([box._zero[2]]))  # just to have a number of the right kind
    device.arm(Plan(TIMER, 500.0, 1))
    block = all_columns(device, read_rows(device.read, 1))
    moved = counts(1, block.host)[0] - box._zero[2]
    assert abs(int(block.counts[0, 1]) - 5000 - int(moved)) < 5 + FASTEST * stamped_within(device), reference
    with pytest.raises(DeviceFault, match="x4 only"):
        device.configure(0, CounterMode.X1)
    with pytest.raises(DeviceFault, match="lower the rate"):
        device.arm(Plan(TIMER, 7000.0, None))
    with pytest.raises(DeviceFault, match="tracker or timer"):
        device.arm(Plan(EdgeSource.POLL, 10.0, None))


def test_a_pulled_cable_leaves_a_gap_in_the_numbers(rig) -> None:
    device, box, _ = rig
    device.open()
    device.arm(Plan(TIMER, 1000.0, None))
    before = all_columns(device, read_rows(device.read, 100))
    off = stamped_within(device)
    box.pull_cable()
    cut = time.monotonic()
    while device._link.connected:
        device.read()
    while time.monotonic() - cut < 0.3:
        assert len(device.read()) == 0
        time.sleep(0.01)
    box.plug_cable()
    after = all_columns(device, read_rows(device.read, 100))
    gap = after.number[0] - before.number[-1]
    seconds = (after.host[0] - before.host[-1]) * 1e-9
    off = max(off, stamped_within(device))
    assert gap == pytest.approx(seconds * 1000, abs=0.6 + 2000 * off) and gap > 250
    both = all_columns(device, [before, after])
    assert np.all(np.diff(both.number) >= 1)
    assert not after.quality.any()
    # Counting went on behind the pulled cable.
    assert counts_off(both, box) < 5 + FASTEST * off


def test_a_reset_is_found_and_marked(rig) -> None:
    device, box, _ = rig
    device.open()
    device.arm(Plan(TIMER, 1000.0, None))
    assert not all_columns(device, read_rows(device.read, 100)).quality.any()
    box.reset(time.monotonic_ns())
    after = all_columns(device, read_rows(device.read, 100, 4.0))
    late = after.quality[after.number > after.number[-1] - 50]
    assert (late[:, :3] & Quality.DEVICE_RESET).all() and not late[:, 3:].any()
    assert np.all(np.diff(after.number) >= 1)


def test_a_device_gone_for_good_is_a_fault(rig) -> None:
    device, box, _ = rig
    device.open()
    device.arm(Plan(TIMER, 1000.0, None))
    read_rows(device.read, 20)
    box.pull_cable()
    with pytest.raises(DeviceFault, match="cable"):
        deadline = time.monotonic() + 6
        while time.monotonic() < deadline:
            device.read()
            time.sleep(0.02)
    assert "connection" in device.check()[0]


def test_overrun_and_recovery_keep_the_numbers_true(rig) -> None:
    """Nobody reads for a second: the network's buffers and the T7's fill, scans are skipped, and counted by the T7."""
    device, box, _ = rig
    device.open()
    device.arm(Plan(TIMER, 6000.0, None))
    first = all_columns(device, read_rows(device.read, 60))
    with box._lock:
        connection, box._stream.connection = box._stream.connection, None  # the network takes nothing for a while
    time.sleep(0.6)
    with box._lock:
        box._stream.connection = connection
    rest = all_columns(device, read_rows(device.read, 3000))
    both = all_columns(device, [first, rest])
    steps = np.diff(both.number)
    assert steps.max() > 500 and np.count_nonzero(steps > 1) == 1
    ticks = np.diff(both.tick) / t7.CORE_TIMER_HZ * 6000
    assert np.abs(ticks - steps).max() < 0.01  # as many numbers as periods, over the hole as well


def test_a_reply_to_another_request_is_passed_over() -> None:
    """A T7 that answers an older request first, in awkward pieces."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_server(("127.0.0.1", 0)) as stream:
        ports = server.getsockname()[1], stream.getsockname()[1]

        def serve() -> None:
            connection, _ = server.accept()
            request = connection.recv(100)
            (number,) = struct.unpack_from(">H", request)
            stale = struct.pack(">HHHBBB4s", (number - 1) & 0xFFFF, 0, 7, 1, 3, 4, struct.pack(">f", 4.0))
            right = struct.pack(">HHHBBB4s", number, 0, 7, 1, 3, 4, struct.pack(">f", 7.0))
            for k in range(0, 26, 5):
                connection.sendall((stale + right)[k : k + 5])
                time.sleep(0.002)
            connection.recv(1)
            connection.close()

        thread = threading.Thread(target=serve)
        thread.start()
        link = driver.T7Link("127.0.0.1", *ports, timeout=2.0)
        link.connect()
        assert link.read_float(t7.PRODUCT_ID) == 7.0 and link.strays == 1
        link.close()
        thread.join()


def test_a_link_closed_by_another_thread_during_an_exchange_is_lost() -> None:
    """As where the guard's thread makes safe while the sampler's thread has given the T7 up."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_server(("127.0.0.1", 0)) as stream:
        link = driver.T7Link("127.0.0.1", server.getsockname()[1], stream.getsockname()[1], timeout=2.0)
        link.connect()
        connection, _ = server.accept()

        class ClosedMeanwhile(modbus_tcp.Frames):
            def feed(self, data: bytes) -> list[modbus_tcp.Frame]:
                link.close()
                return super().feed(data)

        link._frames = ClosedMeanwhile()
        # The beginning of a reply only, so that more is waited for.
        connection.sendall(bytes(3))
        with pytest.raises(LinkLost):
            link.write_float(t7.DAC, 0.0)
        connection.close()


def test_garbage_on_the_stream_ends_the_connection_not_the_truth(rig) -> None:
    device, box, _ = rig
    device.open()
    device.arm(Plan(TIMER, 1000.0, None))
    before = all_columns(device, read_rows(device.read, 50))
    off = stamped_within(device)
    with box._lock:
        box._outgoing += b"\x99" * 64
    after = all_columns(device, read_rows(device.read, 200))
    off = max(off, stamped_within(device))
    both = all_columns(device, [before, after])
    assert np.all(np.diff(both.number) >= 1)
    assert counts_off(both, box) < 5 + FASTEST * off


def test_a_stream_in_awkward_pieces_is_the_same_stream(rig) -> None:
    """44 bytes at a time, so that headers and values are torn; nothing is lost, doubled or shifted."""
    device, box, _ = rig
    device.open()
    box.piece = 44
    device.arm(Plan(TIMER, 500.0, 200))
    block = all_columns(device, read_rows(device.read, 200))
    assert block.number.tolist() == list(range(len(block))) and not block.quality.any()
    off = stamped_within(device)
    assert counts_off(block, box) < 5 + FASTEST * off


def test_half_a_packet_is_no_packet(rig) -> None:
    """The connection is cut in the middle of a packet: the half is thrown away, and the run goes on behind the gap."""
    device, box, _ = rig
    device.open()
    device.arm(Plan(TIMER, 1000.0, None))
    before = all_columns(device, read_rows(device.read, 50))
    box.piece, box.cut_after = 44, 1000
    after = all_columns(device, read_rows(device.read, 300))
    off = stamped_within(device)
    assert box.cut_after is None
    both = all_columns(device, [before, after])
    steps = np.diff(both.number)
    assert np.all(steps >= 1) and np.count_nonzero(steps > 1) == 1 and not both.quality.any()
    assert counts_off(both, box) < 5 + FASTEST * off


def test_another_t7_behind_the_cable_is_not_taken_for_it(rig) -> None:
    device, box, _ = rig
    device.open()
    device.arm(Plan(TIMER, 1000.0, None))
    read_rows(device.read, 20)
    box.close()
    while device._link.connected:
        device.read()  # what was still under way
    other = simulator.make("other", box.config, swing_wires(), serial=470099999)
    other.open()
    with pytest.raises(DeviceFault, match="another T7 answers: serial number 470099999, not 470012345"):
        deadline = time.monotonic() + 6
        while time.monotonic() < deadline:
            assert len(device.read()) == 0
            time.sleep(0.02)
    other.close()


def test_a_clock_that_drifts_is_followed(rig) -> None:
    device, box, _ = rig
    box.clock_ppm = 100.0
    device.open()
    device.arm(Plan(TIMER, 2000.0, None))
    begun = time.monotonic()
    off = np.inf
    # 100 ppm over 3 s is 0.3 ms, and ever more; the remainder is the round trip of a reading. A busy host has to wait
    # for quick ones.
    while (passed := time.monotonic() - begun) < 3.2 or off > 200_000:
        assert passed < 30, f"off by {off * 1e-3:.0f} us"
        block = all_columns(device, read_rows(device.read, 200))
        due = box._started + (block.number + 1) / (2000.0 * (1 + 100e-6)) * 1e9
        off = np.abs(block.host - due).max()


def test_its_own_watchdog_lowers_the_outputs() -> None:
    """The computer is dead: no command comes. (What arrives last is a stream, which does not feed the watchdog.)."""
    switched = []
    wires = swing_wires()
    wires.line = lambda name, high, at: switched.append((name, high))
    where = config(watchdog=1)
    box = simulator.make("t7", where, wires)
    box.open()
    device = driver.make("t7", where, RigContext())
    device.open()
    device.arm(Plan(TIMER, 1000.0, None))
    device.write_line("start", True)
    device.write_volts(0, 3.0)
    deadline = time.monotonic() + 3
    while time.monotonic() < deadline and not box.tripped:
        time.sleep(0.02)
    assert box.tripped == 1 and switched[-1] == ("start", False) and box.dacs == [0.0, 0.0]
    device.close()
    box.close()


def test_refused_configurations() -> None:
    for options, what in (
        ({"counters": (4,)}, "cannot count"),
        ({"lines": {"start": 19}}, "CIO3"),
        ({"lines": {"start": 1}}, "encoder"),
    ):
        with pytest.raises(ValueError, match=what):
            config(**options)


def test_another_device_at_its_address_is_told_from_a_t7() -> None:
    where = config()
    box = simulator.make("t7", where, swing_wires())
    box.registers.put(t7.PRODUCT_ID, struct.pack(">f", 4.0))
    box.open()
    with pytest.raises(DeviceFault, match="product 4, not a T7"):
        driver.make("t7", where, RigContext()).open()
    box.close()
    with pytest.raises(DeviceFault, match="on the network"):
        driver.make("t7", where, RigContext()).open()
