"""A T7 clocked by a tracker over its trigger line, points over UDP.

a tracker that stops early, and one whose clock drifts.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from daq.acquisition.acquisition import Acquisition
from daq.acquisition.rows import Rows
from daq.acquisition.states import End
from daq.rig.bench import open_bench
from daq.rig.rig_file import read_rig
from drivers.labjack_t7 import device as labjack_t7
from drivers.tracker_stream import device as tracker_stream
from sim_backend.protocol import labjack_t7 as sim_t7
from sim_backend.protocol import tracker_stream as sim_tracker
from sim_backend.protocol.wires import TriggerLine
from tests.drivers.swing import points, swing_wires
from tests.ports import free_port

RATE = 500.0
RIG = """
name = "tracked-{run}"
[trigger]
source = "tracker"
device = "daq"
rate = 500.0
[[device]]
name = "daq"
driver = "drivers.labjack_t7"
host = "127.0.0.1"
port = {port}
stream_port = {stream_port}
counters = [0]
inputs = [0]
timeout = 1.0
[[device]]
name = "tracker"
driver = "drivers.tracker_stream"
port = {udp}
unit = "mm"
rate = 500.0
[outputs.start]
device = "daq"
line = "start"
[[joint]]
encoder = {{ device = "daq", channel = 0, lines = 1000, preset = 0 }}
[tracker]
device = "tracker"
target = [0.0, 0.0, 0.0]
"""


def run(folder: Path, seconds: float, **faults: object) -> tuple[Acquisition, list[Rows], sim_tracker.SimulatedTracker]:
    """The rig's run with a tracker of these faults."""
    ports = {"port": free_port(), "stream_port": free_port(), "udp": free_port()}
    path = folder / "rig.toml"
    path.write_text(RIG.format(run=os.getpid(), **ports))
    line = TriggerLine()
    where = labjack_t7.Config(
        host="127.0.0.1", port=ports["port"], stream_port=ports["stream_port"], counters=(0,), inputs=(0,)
    )
    box = sim_t7.make("daq", where, swing_wires(line))
    there = tracker_stream.Config(port=ports["udp"], unit="mm", rate=RATE)
    tracker = sim_tracker.make("tracker", there, swing_wires(line))
    for name, value in faults.items():
        setattr(tracker, name, value)
    box.wires.line = lambda name, high, at: tracker.start(at) if high else tracker.stop()
    box.open()
    tracker.open()
    try:
        with open_bench(read_rig(path)) as bench:
            acquisition = Acquisition(bench, seconds=seconds)
            blocks = list(acquisition.rows())
    finally:
        tracker.close()
        box.close()
    return acquisition, blocks, tracker


def test_a_tracker_that_stops_early_ends_the_run_with_its_rows(tmp_path: Path) -> None:
    acquisition, blocks, tracker = run(tmp_path, 3.0, stop_after=300)
    assert acquisition.ending is not None and acquisition.ending.reason is End.TRIGGER_STOPPED
    number = np.concatenate([rows.number for rows in blocks])
    assert number.tolist() == list(range(300)) and acquisition.ending.detail == "after trigger 299"
    assert acquisition.ledger.summary().lost == 0  # what it never sampled was never a trigger
    measured = np.concatenate([rows.points for rows in blocks])
    true = points(np.array(tracker.edges))
    there = np.isfinite(measured).all(axis=1)
    assert there.mean() > 0.9 and np.abs(measured - true)[there].max() < 1e-8


def test_a_tracker_whose_clock_is_fast_shifts_nothing(tmp_path: Path) -> None:
    acquisition, blocks, tracker = run(tmp_path, 3.0, clock_ppm=100.0)
    number = np.concatenate([rows.number for rows in blocks])
    assert number.tolist() == list(range(1500)) and acquisition.ledger.summary().lost == 0
    measured = np.concatenate([rows.points for rows in blocks])
    there = np.isfinite(measured).all(axis=1)
    assert there.mean() > 0.9
    assert np.abs(measured - points(np.array(tracker.edges[:1500])))[there].max() < 1e-8
    # The edges are the clock: rows carry the T7's time of them, to a tick and its stamps' uncertainty.
    tick = np.concatenate([rows.tick for rows in blocks])
    away = (tick - tick[0]) * 25 - (np.array(tracker.edges[:1500]) - tracker.edges[0])
    assert np.abs(away).max() < 50
    assert np.diff(tick).mean() / 40e6 * RATE == pytest.approx(1 / (1 + 100e-6), abs=10e-6)
