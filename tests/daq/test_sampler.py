"""The sampler on in-memory instruments.

Every trigger is a row or a loss with its reason, and no row is ever shifted.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import DeviceFault, InputError
from daq.acquisition.acquisition import Acquisition
from daq.acquisition.ledger import LossReason
from daq.acquisition.states import End, State
from daq.rig.bench import open_bench
from drivers.protocols import Block, Quality
from experiment import Experiment
from tests.daq.benches import assert_no_row_is_shifted, make_rig, run, take
from tests.daq.instruments import STEP

MOTION = {
    "name": "there and back",
    "start": [0.3, -0.2],
    "full_speed": [1.0, 1.0],
    "full_acceleration": [10.0, 10.0],
    "segment": [{"type": "hold", "duration": 0.1}, {"type": "drive", "joint": 1, "by": 0.2}],
}
TRACKER = {"name": "tracker", "kind": "tracker"}


def test_every_trigger_of_a_clean_run_is_a_row() -> None:
    acquisition, rows = run(make_rig(more=[TRACKER], tracker={"device": "tracker"}), seconds=0.7)
    assert rows is not None
    assert acquisition.state is State.DONE
    assert acquisition.ending is not None and acquisition.ending.reason is End.ROWS_DONE
    assert np.array_equal(rows.number, np.arange(700))
    assert_no_row_is_shifted(rows)
    assert (rows.quality == Quality.GOOD).all()
    assert rows.quality.shape == (700, 2 + 4 + 1)
    account = acquisition.ledger.summary()
    assert (account.triggers, account.latched, account.recorded, account.lost) == (700, 700, 700, 0)
    assert acquisition.notes == []
    assert np.array_equal(np.diff(rows.wall_ns), np.diff(rows.host_ns))


def test_raw_values_become_angles_and_currents_in_the_joints_sense() -> None:
    _, rows = run(make_rig(), seconds=0.1)
    assert rows is not None
    for joint, gear in enumerate((-60.0, 100.0)):
        motor_turns = rows.counts[:, joint] / (4 * 250)
        assert np.allclose(rows.q[:, joint], 2 * np.pi * motor_turns / gear)
        motor_current = rows.volts[:, joint] * 200 / 10 / 10
        assert np.allclose(rows.i[:, joint], np.sign(gear) * motor_current)


def test_the_counters_are_preset_to_the_pose_in_which_the_experiment_starts() -> None:
    more = [{"name": "arm", "kind": "controller", "channels": 2}]
    experiment = Experiment.model_validate(MOTION)
    acquisition, rows = run(make_rig(more=more), experiment=experiment)
    assert rows is not None
    assert acquisition.ending is not None and acquisition.ending.reason is End.MOTION_DONE
    assert rows.q[0] == pytest.approx(experiment.start, abs=2 * np.pi / 1000 / 60)
    assert rows.qref is not None and rows.qref[0] == pytest.approx(experiment.start)
    assert rows.qref[-1] == pytest.approx([0.5, -0.2], abs=1e-3)
    presets = tuple(round(q * 1000 * gear / (2 * np.pi)) for q, gear in zip(experiment.start, (-60, 100)))
    assert_no_row_is_shifted(rows, presets)


@given(
    unseen=st.lists(st.integers(20, 250), max_size=5, unique=True),
    analog_unseen=st.lists(st.integers(20, 250), max_size=5, unique=True),
    dropped=st.lists(st.integers(20, 250), max_size=8, unique=True),
    spurious=st.lists(st.integers(20, 250), max_size=2, unique=True),
    latency=st.floats(0, 0.04),
    jitter=st.floats(0, 1e-4),
    drift=st.floats(-1e-3, 1e-3),
    numbered=st.booleans(),
    ticks=st.booleans(),
)
@settings(max_examples=30)
def test_the_ledger_balances_and_no_row_is_shifted_whatever_is_lost(
    unseen: list[int],
    analog_unseen: list[int],
    dropped: list[int],
    spurious: list[int],
    latency: float,
    jitter: float,
    drift: float,
    numbered: bool,
    ticks: bool,
) -> None:
    # Without clock and numbers, an edge too many cancels one that was missed within one reading (10 ms) and 2 rows.
    spurious = [edge for edge in spurious if not any(abs(edge - other) <= 12 for other in analog_unseen + dropped)]
    unseen, analog_unseen = _apart(unseen), _apart(analog_unseen)
    analog: dict[str, Any] = {"unseen": analog_unseen, "spurious": spurious, "latency": latency, "jitter": jitter}
    # Which of two neighbours was missed, and which only not delivered, cannot be known, and need not be.
    dropped = [edge for edge in dropped if numbered and not any(abs(edge - other) < 2 for other in analog_unseen)]
    analog["dropped"] = dropped
    analog |= {"numbered": numbered, "tick_rate": 1e6 if ticks else None, "tick_drift": 3e-5}
    card = {"unseen": unseen, "drift": drift}
    acquisition, rows = run(make_rig(card, analog), seconds=0.3)
    assert rows is not None
    assert_no_row_is_shifted(rows)
    lost = set(unseen) | set(analog_unseen) | set(dropped)
    assert set(rows.number.tolist()) == set(range(300)) - lost
    account = acquisition.ledger.summary()
    assert acquisition.ledger.imbalance() is None
    assert (account.triggers, account.latched, account.lost) == (300, len(rows), len(lost))
    reasons = {loss.first + i: loss.reason for loss in account.losses for i in range(loss.rows)}
    for edge in lost:
        missed = edge in unseen or edge in analog_unseen
        assert reasons[edge] is (LossReason.LOST_EDGE if missed else LossReason.NOT_LATCHED)


def _apart(edges: list[int]) -> list[int]:
    """Edges far enough from each other to be seen one by one."""
    chosen: list[int] = []
    for edge in sorted(edges):
        if not chosen or edge - chosen[-1] > 5:
            chosen.append(edge)
    return chosen


def test_devices_that_latch_late_are_waited_for() -> None:
    rig = make_rig(
        {"latency": 0.03}, {"latency": 0.11}, more=[TRACKER | {"latency": 0.06}], tracker={"device": "tracker"}
    )
    acquisition, rows = run(rig, seconds=0.5)
    assert rows is not None and len(rows) == 500
    assert acquisition.ledger.summary().lost == 0
    assert rows.points is not None and not np.isnan(rows.points).any()
    assert_no_row_is_shifted(rows)


def test_a_line_that_runs_before_it_is_armed_is_aligned_by_time() -> None:
    for outputs in ({}, {"start": {"device": "card", "line": "start"}}):
        rig = make_rig(
            analog={"free_running": True}, outputs=outputs, simulation={"own_time": True, "slow_arming": True}
        )
        acquisition, rows = run(rig, seconds=0.3)
        assert rows is not None
        assert np.array_equal(rows.number, np.arange(300))
        assert acquisition.ledger.summary().lost == 0
        edge = rows.counts[:, 0] // STEP
        assert edge[0] > 20 and (np.diff(edge) == 1).all()
        assert np.allclose(rows.volts[:, 0], edge * 1e-3)


def test_a_device_that_is_unplugged_ends_the_run_and_every_trigger_is_accounted_for() -> None:
    acquisition, rows = run(make_rig(analog={"gone_at": 205}), seconds=2.0)
    assert rows is not None
    assert acquisition.state is State.FAULT
    assert acquisition.ending is not None and acquisition.ending.reason is End.DEVICE_LOST
    assert "check its cable" in acquisition.ending.detail
    account = acquisition.ledger.summary()
    assert acquisition.ledger.imbalance() is None
    assert {loss.reason for loss in account.losses} == {LossReason.DEVICE_GONE}
    assert 200 <= len(rows) <= 206
    assert_no_row_is_shifted(rows)


def test_rows_that_a_device_lost_before_it_was_unplugged_are_losses_of_their_own() -> None:
    """The clock is 50 ms late: some of these triggers are accounted for when the device is already gone."""
    lost = list(range(150, 165))
    acquisition, rows = run(make_rig({"latency": 0.05}, {"gone_at": 205, "dropped": lost}), seconds=2.0)
    assert rows is not None and np.array_equal(rows.number, np.arange(150))
    assert acquisition.ending is not None and acquisition.ending.reason is End.DEVICE_LOST
    losses = acquisition.ledger.summary().losses
    assert {(loss.reason, loss.detail) for loss in losses} == {(LossReason.NOT_LATCHED, "analog")}


def test_a_device_that_falls_silent_ends_the_run() -> None:
    acquisition, rows = run(make_rig(analog={"silent_at": 300}), seconds=5.0)
    assert rows is not None and len(rows) == 300
    assert acquisition.ending is not None and acquisition.ending.reason is End.DEVICE_SILENT
    assert acquisition.ledger.imbalance() is None
    assert acquisition.ledger.summary().lost > 400


@pytest.mark.parametrize(("edges", "reason"), [(0, End.NO_TRIGGER), (400, End.TRIGGER_STOPPED)])
def test_a_quiet_trigger_line_ends_the_run(edges: int, reason: End) -> None:
    acquisition, rows = run(make_rig({"line_stops_at": edges}), seconds=5.0)
    assert (0 if rows is None else len(rows)) == edges
    assert acquisition.ending is not None and acquisition.ending.reason is reason
    assert acquisition.ledger.imbalance() is None


def test_a_tracker_with_a_full_memory_is_named_as_such() -> None:
    tracker = {"name": "tracker", "kind": "tracker", "memory": 250}
    rig = make_rig({"line_stops_at": 250}, more=[tracker], tracker={"device": "tracker"})
    acquisition, rows = run(rig)
    assert rows is not None and len(rows) == 250
    assert acquisition.ending is not None and acquisition.ending.reason is End.TRACKER_FULL


def test_points_that_stay_in_the_tracker_are_merged_after_the_run() -> None:
    tracker = {"name": "tracker", "kind": "memory_tracker", "memory": 1000, "dropped": [40, 41]}
    rig = make_rig(more=[tracker], tracker={"device": "tracker"})
    _, rows = run(rig, seconds=0.8)
    assert rows is not None and len(rows) == 800
    assert rows.points is not None
    assert np.flatnonzero(np.isnan(rows.points[:, 0])).tolist() == [40, 41]
    assert np.flatnonzero(rows.quality[:, -1]).tolist() == [40, 41]
    assert_no_row_is_shifted(rows)


def test_more_rows_than_the_tracker_holds_are_refused_with_what_would_be_right() -> None:
    rig = make_rig(more=[{"name": "tracker", "kind": "memory_tracker"}], tracker={"device": "tracker"})
    with pytest.raises(InputError, match="has 1000 samples, the run makes 4000: lower the rate to 250 rows/s"):
        run(rig, seconds=4.0)


def test_a_rate_above_a_devices_ceiling_is_refused() -> None:
    with pytest.raises(InputError, match="analog latches at most 800 rows/s, not 1000"):
        run(make_rig(analog={"max_rate": 800.0}), seconds=1.0)


def test_a_slow_device_without_latch_is_joined_by_time_and_its_repeats_are_stale() -> None:
    slow = {"name": "slow", "kind": "polled", "channels": 1, "max_rate": 100.0}
    _, rows = run(make_rig(more=[slow]), seconds=0.5)
    assert rows is not None and len(rows) == 500
    assert_no_row_is_shifted(rows)
    asked, stale = rows.volts[:, 4], rows.quality[:, 6] == Quality.STALE
    now = rows.host_ns * 1e-6 % 1e6
    assert np.abs(asked - now)[20:].max() <= 5.0 + 1e-6
    assert np.count_nonzero(~stale) == pytest.approx(50, abs=2)
    assert np.abs(asked - now)[~stale][2:].max() <= 1.0 + 1e-6


def test_a_rig_without_any_line_is_polled() -> None:
    slow = {"name": "slow", "kind": "polled", "channels": 4}
    rig = make_rig(
        more=[slow],
        rate=100.0,
        trigger={"source": "poll", "device": "slow", "rate": 100.0},
        joint=[{"current": {"device": "slow", "channel": 0, "rated_current": 1.0, "rated_voltage": 1.0}}],
        device=[{"driver": "tests.daq.instruments", **slow}],
        outputs={},
    )
    acquisition, rows = run(rig, seconds=0.5)
    assert rows is not None
    assert np.array_equal(rows.number, np.arange(50))
    assert np.allclose(np.diff(rows.host_ns), 1e7)
    assert acquisition.ledger.summary().lost == 0


def test_stamps_of_the_arrival_become_an_even_grid_that_is_never_early() -> None:
    acquisition, rows = run(make_rig({"arrival": True}), seconds=1.0)
    assert rows is not None and len(rows) == 1000
    intervals = np.diff(rows.host_ns) * 1e-6
    assert intervals.min() > 0.5 and np.abs(intervals - 1).max() < 0.1
    assert any("too uneven" in note for note in acquisition.notes)


def test_a_24_bit_counter_that_wraps_at_speed_is_followed() -> None:
    _, rows = run(make_rig({"bits": 12}), seconds=3.0)
    assert rows is not None
    assert rows.counts[-1, 1] == 2999 * 6 > 4 * 2**12
    assert_no_row_is_shifted(rows)


def test_a_real_thread_stops_a_run_on_the_real_clock() -> None:
    rig = make_rig(own_time=False, analog={"latency": 0.002})
    with open_bench(rig) as bench:
        acquisition = Acquisition(bench)
        stopper = threading.Timer(0.25, acquisition.stop)
        stopper.start()
        rows = list(acquisition.rows())
    assert acquisition.ending is not None and acquisition.ending.reason is End.STOPPED
    account = acquisition.ledger.summary()
    assert account.latched == sum(map(len, rows)) == account.triggers
    assert account.latched > 50


def test_a_bench_takes_one_run_after_the_other() -> None:
    with open_bench(make_rig()) as bench:
        for _ in range(3):
            acquisition, rows = take(bench, seconds=0.2)
            assert rows is not None and np.array_equal(rows.number, np.arange(200))
            assert_no_row_is_shifted(rows)
            assert acquisition.state is State.DONE


def test_a_consumer_that_leaves_the_loop_leaves_everything_safe() -> None:
    with open_bench(make_rig()) as bench:
        acquisition = Acquisition(bench, seconds=1.0)
        for _ in acquisition.rows():
            break
        assert acquisition.ending is not None and acquisition.ending.reason is End.ABANDONED
        assert bench.devices["card"].is_safe  # type: ignore[attr-defined]


def test_states_go_one_way() -> None:
    with open_bench(make_rig()) as bench:
        acquisition = Acquisition(bench, seconds=0.05)
        with pytest.raises(DeviceFault, match="is idle"):
            acquisition.start()
        acquisition.arm()
        acquisition.disarm()
        acquisition.arm()
        list(acquisition.rows())
        with pytest.raises(DeviceFault, match="is done"):
            acquisition.arm()


def test_host_that_pauses_in_the_reading_saw_no_quiet_line() -> None:
    """Longer than the patience, between the clock's reading and the judgement.

    The edges of the pause are still to be read.
    """
    with open_bench(make_rig(watchdog=10.0)) as bench:
        read, clock, calls = bench.devices["analog"].read, bench.clock, []

        def pause() -> Block:
            calls.append(None)
            if len(calls) == 20:
                clock.sleep(0.8)
            return read()

        bench.devices["analog"].read = pause  # type: ignore[attr-defined]
        acquisition, rows = take(bench, seconds=2.0)
    assert acquisition.ending is not None
    assert acquisition.ending.reason is End.ROWS_DONE
    assert rows is not None
    assert len(rows) == 2000
