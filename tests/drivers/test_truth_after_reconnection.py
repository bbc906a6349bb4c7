"""Devices lost and found in the middle of a run, against the truth.

Every row after it shows its trigger's counts, volts and points.

While the run goes on, each device is cut off (its cable; it keeps its power) and later restarted (its power). A row's
values must be those of the simulated signals at the row's own time: no shift by a row, no offset of a count, unless the
row says so.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from armscope.commands.sim_devices import simulated_devices
from daq.acquisition.acquisition import Acquisition
from daq.acquisition.rows import Rows
from daq.acquisition.states import End
from daq.rig.bench import open_bench
from daq.rig.rig_file import Rig, read_rig
from drivers.protocols import Quality
from drivers.registry import find_driver
from sim_backend.protocol.wires import TriggerLine
from tests.daq.benches import joined
from tests.drivers.swing import AMPLITUDE, counts, points, swing_wires, volts
from tests.drivers.test_whole_rigs import motion, rig_for_test
from tests.ports import free_port

CUT, AWAY, RESTART, SECONDS = 0.4, 0.12, 1.1, 2.1
"""s: when the cable is pulled, for how long, when the power goes, and the end of the run."""
NOT_NOW = Quality.MISSING | Quality.STALE | Quality.LATE  # a row so marked does not show the value at its time
FEW = 10  # rows from which a delay can be estimated
Signal = Callable[[NDArray[np.int64]], NDArray[Any]]


@dataclass
class Case:
    """A device alone, as the rig file has it, and what happens to it."""

    driver: str
    options: dict[str, Any]
    counters: int = 0
    inputs: int = 0
    source: str = "poll"
    rate: float = 100.0
    absolute: bool = False  # absolute encoder: no restart loses its position
    cable_is_power: bool = False
    cut: Callable[[Any], None] = field(default=lambda box: box.pull_cable())
    back: Callable[[Any], None] = field(default=lambda box: box.plug_cable())
    restart: Callable[[Any], None] = field(default=lambda box: box.reset(time.monotonic_ns()))


def t7() -> Case:
    ports = {"host": "127.0.0.1", "port": free_port(), "stream_port": free_port()}
    options = {**ports, "counters": [0, 2], "inputs": [0, 1], "timeout": 1.0}
    return Case("labjack_t7", options, 2, 2, "timer", 500.0)


def qsb(folder: Path, reading: str) -> Case:
    """USB is its power; it restarts with its cable in, too, where the computer's port has a dip."""
    options = {"port": f"{folder}/qsb", "reading": reading, "timeout": 0.2}
    return Case("us_digital_qsb", options, 1, cable_is_power=True)


def ad4b(folder: Path) -> Case:
    return Case("us_digital_ad4b", {"port": f"{folder}/ad4b", "timeout": 0.2}, 1)


def cia406(folder: Path, sync: Any) -> Case:
    options = {"interface": "unix", "channel": f"{folder}/can", "nodes": [1, 2], "bits": 25, "latest": 0.05}
    options |= {"timeout": 0.03, "sync": sync}
    case = Case("cia406", options, 2, 0, "poll" if sync == "host" else "timer", absolute=True)
    case.cut, case.back = (lambda box: box.close()), (lambda box: box.open())
    case.restart = lambda box: box.restart(2)
    return case


def ivts(folder: Path) -> Case:
    sensors = [{"command": 0x411 + k, "reply": 0x511 + k, "result": 0x521 + 16 * k} for k in range(2)]
    options = {"interface": "unix", "channel": f"{folder}/can", "period": 5, "sensors": sensors, "timeout": 0.3}
    case = Case("isabellenhuette_ivts", options, 0, 2)
    case.cut, case.back = (lambda box: box.close()), (lambda box: box.open())
    case.restart = lambda box: box.restart(1)
    return case


def rig_of(case: Case) -> Rig:
    sensor = {"device": "box", "rated_current": 1.0, "rated_voltage": 1.0}
    joints: list[dict[str, Any]] = [{} for _ in range(max(case.counters, case.inputs))]
    for channel in range(case.counters):
        joints[channel]["encoder"] = {"device": "box", "channel": channel, "counts_per_radian": 1e4}
    for channel in range(case.inputs):
        joints[channel]["current"] = {**sensor, "channel": channel}
    return Rig.model_validate(
        {
            "name": f"truth-{os.getpid()}",
            "trigger": {"source": case.source, "device": "box", "rate": case.rate},
            "device": [{"name": "box", "driver": f"drivers.{case.driver}", **case.options}],
            "joint": joints,
        }
    )


def simulated(driver: str, options: dict[str, Any], line: TriggerLine | None = None) -> Any:
    config = find_driver(f"drivers.{driver}").Config.model_validate(options)
    module = __import__(f"sim_backend.protocol.{driver}", fromlist=["make"])
    return module.make(driver, config, swing_wires(line))


def acquire(
    rig: Rig, boxes: list[Any], events: list[tuple[float, Callable[[], None]]]
) -> tuple[Acquisition, Rows, int]:
    """A run in which things happen at times, s; its rows, and the host ns of its start."""
    with ExitStack() as stack:
        for box in boxes:
            box.open()
            stack.callback(box.close)
        bench = stack.enter_context(open_bench(rig))
        acquisition = Acquisition(bench, seconds=SECONDS)
        acquisition.arm()
        acquisition.start()
        timers = [threading.Timer(at, event) for at, event in events]
        for timer in timers:
            timer.start()
        blocks = list(acquisition.rows())
        for timer in timers:
            timer.join()
    assert acquisition.ledger.imbalance() is None
    return acquisition, joined(blocks), acquisition.started_ns


def delay_of(value: NDArray[Any], truth: Signal, host: NDArray[np.int64]) -> tuple[float, float, float]:
    """s by which values are older than their rows' times, its standard deviation, and their offset from the truth.

    Least squares without the worst tenths. At a constant speed a delay is an offset: the deviation says so.
    """
    step = 1_000_000
    speed = (truth(host + step) - truth(host - step)) / (2e-9 * step)
    error = (value - truth(host)).astype(float)
    rows = np.column_stack([-speed, np.ones(len(speed))])
    kept = np.ones(len(error), bool)
    for share in (0.9, 0.8, 0.8):
        (delay, offset), *_ = np.linalg.lstsq(rows[kept], error[kept], rcond=None)
        left = np.abs(error - rows @ (delay, offset))
        kept = left <= np.quantile(left, share)
    deviation = np.sqrt(np.mean(left**2) * np.linalg.pinv(rows.T @ rows)[0, 0])
    return float(delay), float(deviation), float(offset)


def judge(
    value: NDArray[Any], truth: Signal, fastest: float, rows: Rows, column: int, rate: float, since: int
) -> dict[str, Any]:
    """Every row that claims to show its time's value does, by less than a row.

    Rows from a restart on have an offset of their own.

    fastest  the signal's highest speed, per s
    since    host ns at which the restart was over, after which rows have to come back; a row within a period of it
             shows the value before it or after it
    """
    quality = rows.quality[:, column]
    shown = (quality & NOT_NOW) == 0
    shown &= np.abs(rows.host_ns - since) > 1e9 / rate
    reset = (quality & Quality.DEVICE_RESET) != 0
    assert not np.any(np.diff(reset.astype(int)) < 0), "a restart stays flagged to the end of the run"
    *_, offset = delay_of(value[shown & ~reset], truth, rows.host_ns[shown & ~reset])
    again = rows.host_ns > since
    for part in (~reset, reset & ~again, reset & again):
        part = part & shown
        if np.count_nonzero(part) < FEW:
            continue
        delay, deviation, found = delay_of(value[part], truth, rows.host_ns[part])
        assert abs(delay) < 0.5 / rate + 4 * deviation, f"column {column}: shifted by {delay * rate:.2f} rows"
        own = found if reset[part][0] else offset
        worst = np.abs(value[part] - truth(rows.host_ns[part]) - own).max() / fastest
        assert worst < 3 / rate, f"column {column}: a row off by {worst * rate:.2f} rows' motion"
    assert np.count_nonzero(shown & (rows.host_ns > since)) > FEW, "nothing came back"
    return {"reset": reset, "shown": shown}


CASES = {
    "t7": lambda folder: t7(),
    "qsb streaming": lambda folder: qsb(folder, "stream"),
    "qsb asked": lambda folder: qsb(folder, "ask"),
    "ad4b": ad4b,
    "cia406 asked": lambda folder: cia406(folder, "host"),
    "cia406 by a node's syncs": lambda folder: cia406(folder, 1),
    "ivts": ivts,
}


@pytest.mark.parametrize("name", CASES)
def test_rows_after_a_cable_and_after_a_restart_are_those_of_their_triggers(tmp_path: Path, name: str) -> None:
    case = CASES[name](tmp_path)
    box = simulated(case.driver, case.options)
    happened: list[int] = []  # host ns at which the cable was pulled, and at which the restart was over

    def cable() -> None:
        happened.append(time.monotonic_ns())
        case.cut(box)
        time.sleep(AWAY)
        case.back(box)

    def restart() -> None:
        case.restart(box)
        happened.append(time.monotonic_ns())

    acquisition, rows, _ = acquire(rig_of(case), [box], [(CUT, cable), (RESTART, restart)])
    assert acquisition.ending is not None and acquisition.ending.reason is End.ROWS_DONE
    cut, restarted = happened
    a_row = 1e9 / case.rate  # ns: the row in progress at a restart may be marked
    for channel in range(case.counters):
        speed = 2 * np.pi * (channel + 1) / 4 * AMPLITUDE
        found = judge(
            rows.counts[:, channel], lambda at, c=channel: counts(c, at), speed, rows, channel, case.rate, restarted
        )
        lost = cut if case.cable_is_power else restarted
        hit = channel == case.counters - 1 or not case.absolute  # of several encoders on a bus, one restarts
        assert found["reset"][-1] == hit and not found["reset"][rows.host_ns < lost - a_row].any()
    for channel in range(case.inputs):
        speed = 2 * np.pi * (channel + 1) / 4 * 3.0
        column = case.counters + channel
        judge(rows.volts[:, channel], lambda at, c=channel: volts(c, at), speed, rows, column, case.rate, restarted)


@pytest.mark.parametrize("sync", ["host", 1])
def test_an_encoder_whose_boot_up_nobody_heard_comes_back_marked(tmp_path: Path, sync: Any) -> None:
    """It was off the bus when it restarted: it answers no SYNC until it is asked for its settings, and set up again."""
    case = cia406(tmp_path, sync)
    box = simulated(case.driver, case.options)

    def unheard() -> None:
        box.close()
        box.restart(2)
        box.open()

    _, rows, begun = acquire(rig_of(case), [box], [(CUT, unheard)])
    a_row = 1e9 / case.rate  # ns: the row in progress at the restart may be marked
    marked = (rows.quality[:, :2] & Quality.DEVICE_RESET) != 0
    assert marked[-1].tolist() == [False, True] and not marked[rows.host_ns < begun + CUT * 1e9 - a_row].any()
    speed = np.pi * AMPLITUDE
    judge(rows.counts[:, 1], lambda at: counts(1, at), speed, rows, 1, case.rate, begun + int(CUT * 1e9))


def tracked(folder: Path) -> tuple[Rig, Any, Any]:
    """A T7 on the line of a tracker that was started by hand, which sends its points by a serial line."""
    box = {"host": "127.0.0.1", "port": free_port(), "stream_port": free_port(), "counters": [0], "inputs": [0]}
    box |= {"timeout": 1.0, "lines": {}}
    stream = {"serial": f"{folder}/tracker", "unit": "mm", "rate": 500.0, "baud": 921600}
    rig = Rig.model_validate(
        {
            "name": f"tracked-{os.getpid()}",
            "trigger": {"source": "tracker", "device": "daq", "rate": 500.0},
            "device": [
                {"name": "daq", "driver": "drivers.labjack_t7", **box},
                {"name": "tracker", "driver": "drivers.tracker_stream", **stream},
            ],
            "joint": [{"encoder": {"device": "daq", "channel": 0, "counts_per_radian": 1e4}}],
            "tracker": {"device": "tracker", "target": [0.0, 0.0, 0.0]},
        }
    )
    line = TriggerLine()
    return rig, simulated("labjack_t7", box, line), simulated("tracker_stream", stream, line)


@pytest.mark.parametrize("what", ["tracker's cable", "t7's cable", "t7's power"])
def test_counts_and_points_stay_those_of_their_edge(tmp_path: Path, what: str) -> None:
    rig, box, tracker = tracked(tmp_path)

    def happens() -> None:
        if what == "t7's power":
            box.reset(time.monotonic_ns())
            return
        gone = tracker if what.startswith("tracker") else box
        gone.pull_cable()
        time.sleep(AWAY)
        gone.plug_cable()

    acquisition, rows, begun = acquire(
        rig, [box, tracker], [(0.1, lambda: tracker.start(time.monotonic_ns())), (0.1 + CUT, happens)]
    )
    assert acquisition.ending is not None and acquisition.ending.reason is End.ROWS_DONE
    edges = np.array(tracker.edges)[rows.number]
    assert rows.points is not None
    there = np.isfinite(rows.points).all(axis=1)
    assert np.abs(rows.points - points(edges))[there].max() < 1e-8
    late = edges > begun + (CUT + 0.6) * 1e9
    assert there[late].mean() > 0.9
    reset = (rows.quality[:, 0] & Quality.DEVICE_RESET) != 0
    assert reset[-1] == (what == "t7's power")
    for part in (~reset, reset):
        offset = rows.counts[part, 0] - counts(0, edges[part])
        assert part.sum() == 0 or np.ptp(offset) <= 1  # counts, and the rounding of their zero


def test_a_tracker_that_restarts_ends_the_run_with_the_rows_so_far(tmp_path: Path) -> None:
    """It samples no more until it is started again: its frames would begin at 1."""
    rig, box, tracker = tracked(tmp_path)
    acquisition, rows, _ = acquire(
        rig, [box, tracker], [(0.1, lambda: tracker.start(time.monotonic_ns())), (0.1 + CUT, tracker.reset)]
    )
    assert acquisition.ending is not None and acquisition.ending.reason is End.TRIGGER_STOPPED
    edges = np.array(tracker.edges)[rows.number]
    assert np.ptp(rows.counts[:, 0] - counts(0, edges)) <= 1
    assert rows.points is not None
    there = np.isfinite(rows.points).all(axis=1)
    assert there.mean() > 0.8 and np.abs(rows.points - points(edges))[there].max() < 1e-8


def test_the_t7_lost_and_found_while_val_drives_the_arm(root: Path, tmp_path: Path) -> None:
    """The laboratory's rig in a motion.

    Counts of three joints and points are those of the tracker's edges before and after.
    """
    changes = {port: str(free_port()) for port in ("50502", "50702", "50703")} | {"/tmp/armscope": str(tmp_path)}
    path = rig_for_test(root, "puma560_lab", tmp_path, changes)
    rig = read_rig(path)
    with simulated_devices(rig, path) as simulators, open_bench(rig) as bench:
        box: Any = simulators[0]
        tracker: Any = simulators[1]

        def cable() -> None:
            box.pull_cable()
            time.sleep(AWAY)
            box.plug_cable()

        acquisition = Acquisition(bench, motion(root))
        acquisition.arm()
        acquisition.start()
        timer = threading.Timer(CUT, cable)
        timer.start()
        rows = joined(list(acquisition.rows()))
        timer.join()
        edges = np.array(tracker.edges)[rows.number]
        truth = np.stack([box.wires.counts(channel, edges) for channel in range(3)], axis=1)
        place = tracker.wires.points(edges)
    assert acquisition.ending is not None and acquisition.ending.reason is End.MOTION_DONE
    assert acquisition.ledger.imbalance() is None and acquisition.ledger.summary().lost > 20
    assert np.ptp(truth[:, 1]) > 1000, "the arm moves"
    assert np.ptp(rows.counts - truth, axis=0).max() <= 1
    assert rows.points is not None
    there = np.isfinite(rows.points).all(axis=1)
    assert there.mean() > 0.9 and np.abs(rows.points - place)[there].max() < 1e-8
