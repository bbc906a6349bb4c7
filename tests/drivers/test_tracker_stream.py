"""The tracker over UDP and over a pty: lost lines, its memory, its file, its end before the end."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from arm_io import DeviceFault
from drivers import RigContext
from drivers.blocks import join
from drivers.protocols import Block, EdgeSource, Plan, PositionTracker, Quality
from drivers.tracker_stream import device as driver
from drivers.tracker_stream.merge import align
from drivers.tracker_stream.protocol import Lines
from sim_backend.protocol import tracker_stream as simulator
from sim_backend.protocol.serving import Terminal
from tests.drivers.swing import points, read_rows, swing_wires
from tests.ports import free_port

ON_EDGES = EdgeSource.TRACKER


@pytest.fixture(params=["udp", "serial"])
def rig(
    request: pytest.FixtureRequest, tmp_path: Path
) -> Iterator[tuple[driver.TrackerStream, simulator.SimulatedTracker]]:
    way = {"port": free_port()} if request.param == "udp" else {"serial": str(tmp_path / "tracker"), "baud": 921_600}
    where = driver.Config(**way, unit="mm", memory=400, rate=500.0, file=str(tmp_path / "points.csv"))
    wires = swing_wires()
    box = simulator.make("tracker", where, wires)
    box.open()
    device = driver.make("tracker", where, RigContext())
    yield device, box
    device.close()
    box.close()


def plan(rows: int | None) -> Plan:
    return Plan(ON_EDGES, 500.0, rows)


def test_points_come_numbered_and_in_metres(rig) -> None:
    device, box = rig
    identity = device.open()
    assert (identity.max_rate, identity.memory) == (1000.0, 400)
    assert isinstance(device, PositionTracker) and device.check() == []
    device.arm(plan(100))
    box.start(time.monotonic_ns())
    block = join(read_rows(device.read, 100), points=True)
    assert block.number[:100].tolist() == list(range(100))
    truth = points(np.array(box.edges[: len(block)]))
    assert block.points is not None and np.abs(block.points - truth).max() < 1e-8
    seconds = np.diff(block.tick) / driver.TICK_HZ
    assert np.abs(seconds - np.diff(box.edges[: len(block)]) * 1e-9).max() < 3e-6


def test_a_lost_line_is_a_gap_and_no_shift(rig) -> None:
    device, box = rig
    device.open()
    device.arm(plan(60))
    box.lose_lines = {1, 20, 21}
    box.start(time.monotonic_ns())
    block = join(read_rows(device.read, 57), points=True)
    assert block.number[:57].tolist() == [n for n in range(60) if n + 1 not in (1, 20, 21)]
    assert np.abs(block.points - points(np.array(box.edges)[block.number])).max() < 1e-8


def test_what_still_comes_of_an_earlier_run_is_not_taken(rig) -> None:
    device, box = rig
    device.open()
    device.arm(plan(300))
    box.start(time.monotonic_ns())
    read_rows(device.read, 20)
    time.sleep(0.03)
    device.arm(plan(300))
    time.sleep(0.03)
    assert len(device.read()) == 0
    box.start(time.monotonic_ns())
    block = join(read_rows(device.read, 20), points=True)
    assert block.number.tolist() == list(range(len(block)))
    assert np.abs(block.points - points(np.array(box.edges)[block.number])).max() < 1e-8


def test_an_earlier_run_is_known_though_nothing_of_it_was_waiting(tmp_path: Path) -> None:
    """Armed between two lines, and in the middle of one: 21 cut in two is no frame 1."""
    port = Terminal("tracker", str(tmp_path / "tracker"))
    port.open()
    device = driver.make("tracker", driver.Config(serial=str(tmp_path / "tracker")), RigContext())
    device.open()
    device.arm(Plan(ON_EDGES, 1000.0, 10))
    port.write(b"1,0.1,1,2,3\n2,0.2,1,2,3\n", 0)
    read_rows(device.read, 2)
    for _ in range(2):  # as the sampler does: on command, and again just before the start
        device.arm(Plan(ON_EDGES, 1000.0, 10))
    port.write(b"19,1.9,9,9,9\n2", 0)
    while not device._lines._rest:
        assert len(device.read()) == 0
    device.arm(Plan(ON_EDGES, 1000.0, 10))
    port.write(b"0,2.0,9,9,9\n21,2.1,9,9,9\n1,0.1,1,2,3\n2,0.2,1,2,3\n", 0)
    block = join(read_rows(device.read, 2), points=True)
    assert block.number.tolist() == [0, 1] and (block.points == [1, 2, 3]).all()
    assert device.check() == []
    device.close()
    port.close()


def test_ceilings_are_checked_before_arming(rig) -> None:
    device, _ = rig
    device.open()
    for asked, what in (
        (Plan(ON_EDGES, 1500.0, 100), "at most 1000"),
        (Plan(ON_EDGES, 500.0, 401), "memory has 400: record at most 0.8 s"),
        (Plan(ON_EDGES, 400.0, 100), "set to 500 Hz"),
    ):
        with pytest.raises(DeviceFault, match=what):
            device.arm(asked)
    device.arm(plan(400))


def test_its_file_is_merged_by_count_and_intervals(rig) -> None:
    """Two edges lost, one spike counted, the tracker's clock 100 ppm fast: every edge still gets its own point."""
    device, box = rig
    device.open()
    device.arm(plan(200))
    box.clock_ppm, box.stop_after = 100.0, 200
    box.lose_edges, box.extra_edges = {1, 77}, {120: 0.0009}
    box.start(time.monotonic_ns())
    read_rows(device.read, 200)
    deadline = time.monotonic() + 2
    while not Path(device.config.file).exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    kept = device.recall()
    assert len(kept) == 200
    edges = box.wires.trigger.between(0, time.monotonic_ns())
    assert len(edges) == 199
    merged = align(edges * 1e-9, kept.number, kept.tick / driver.TICK_HZ)
    assert merged.certain and (merged.frame < 0).sum() == 1
    paired = merged.frame >= 0
    assert np.array_equal(edges[paired], np.array(box.edges)[merged.frame[paired]])


def test_a_tracker_that_stops_early_just_ends(rig) -> None:
    device, box = rig
    device.open()
    device.arm(plan(300))
    box.stop_after = 50
    box.start(time.monotonic_ns())
    block = join(read_rows(device.read, 50), points=True)
    time.sleep(0.1)
    assert len(block) == 50 and len(device.read()) == 0
    assert len(box.wires.trigger.between(0, time.monotonic_ns())) == 50


def test_a_cable_pulled_and_put_back_leaves_a_gap_in_the_numbers(rig) -> None:
    device, box = rig
    if box._terminal is None:
        pytest.skip("a lost datagram is a gap already")
    device.open()
    device.arm(plan(400))
    box.start(time.monotonic_ns())
    before = join(read_rows(device.read, 20), points=True)
    with box._lock:
        box._terminal.close()
    while not device.seeking:
        device.read()
    with box._lock:
        box._terminal.open()
    after = join(read_rows(device.read, 20), points=True)
    assert not device.seeking
    number = np.concatenate([before.number, after.number])
    assert (np.diff(number) > 0).all() and np.diff(number).max() > 1
    measured = np.concatenate([before.points, after.points])
    assert np.abs(measured - points(np.array(box.edges)[number])).max() < 1e-8


def test_half_a_line_after_a_cut_is_no_point() -> None:
    lines = Lines()
    assert len(lines.feed(b"1,0.1,1,2,3\n20,0.2,1,2")) == 1
    lines.resume()
    frames = lines.feed(b"2,9,9,9\n21,0.3,1,2,3\n")
    assert frames.number.tolist() == [21] and lines.refused == 0


def test_a_broken_beam_is_a_missing_point(rig) -> None:
    device, box = rig
    device.open()
    device.arm(plan(20))
    truth = box.wires.points
    box.wires.points = lambda at: np.where(np.arange(len(at))[:, None] == 0, np.nan, truth(at))
    box.start(time.monotonic_ns())
    block = join(read_rows(device.read, 20), points=True)
    gone = np.isnan(block.points).any(axis=1)
    assert gone.any() and np.array_equal(gone, block.quality[:, 0] == Quality.MISSING)


def test_datagrams_of_others_and_old_ones_are_not_taken() -> None:
    where = driver.Config(port=free_port(), sender="127.0.0.2")
    device = driver.make("tracker", where, RigContext())
    device.open()
    device.arm(Plan(ON_EDGES, 1000.0, 10))
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tracker,
    ):
        tracker.bind(("127.0.0.2", 0))
        address = ("127.0.0.1", where.port)
        other.sendto(b"1,0.1,1,2,3\n", address)
        for line in (
            b"2,0.2,1,2,3\n",
            b"4,0.4,1,2,3\n",
            b"3,0.3,9,9,9\n",
            b"4,0.4,9,9,9",
            b"rubbish\n",
            b"5,0.5,1,2,3",
        ):
            tracker.sendto(line, address)
        block: Block = join(read_rows(device.read, 3), points=True)
    assert block.number.tolist() == [1, 3, 4] and (block.points == [1, 2, 3]).all()
    assert "1 lines" in device.check()[0]
    device.close()


def test_refused_configurations() -> None:
    for options, what in (
        ({}, "either"),
        ({"port": 1, "serial": "x"}, "either"),
        ({"port": 5, "rate": 1200.0}, "more than"),
        ({"port": 5, "host": "0.0.0.0"}, "sender"),
    ):
        with pytest.raises(ValueError, match=what):
            driver.Config.model_validate(options)


def test_no_file_is_a_fault(tmp_path: Path) -> None:
    for options, what in (({}, "keeps no file"), ({"file": str(tmp_path / "none.csv")}, "has the tracker written it")):
        with pytest.raises(DeviceFault, match=what):
            driver.make("tracker", driver.Config(port=5, **options), RigContext()).recall()
    (tmp_path / "bad.csv").write_text("frame,seconds,x,y,z\n1,0.1,1,2,3\nrubbish\n")
    with pytest.raises(DeviceFault, match="not every line"):
        driver.make("tracker", driver.Config(port=5, file=str(tmp_path / "bad.csv")), RigContext()).recall()
