"""The simulated rig behind the drivers' shapes, read as a sampler reads it; the plant follows its demand exactly."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from arm_io import DeviceFault, InputError
from drivers import RigContext, protocols
from drivers.counting import extend
from drivers.protocols import CounterMode, EdgeSource, Plan, Quality
from experiment import Experiment, demand_of
from sim_backend import lab_pc, mit_c12
from sim_backend.electronics import quadrature
from sim_backend.rig.clock import FastClock
from sim_backend.rig.faults import (
    BeamBreak,
    ClockDrift,
    DeviceReset,
    EmiCounts,
    ExtraEdge,
    LostEdge,
    LostRow,
    StuckChannel,
    TrackerStops,
    Unplugged,
)
from tests.sim_backend.plants import GEAR, LINES, chirps, current_of
from tests.sim_backend.rigs import begin, make_rig, read_for

PER_RADIAN = GEAR * LINES * 4 / (2 * np.pi)


def test_devices_have_the_shapes_they_say() -> None:
    rig = make_rig()
    for device in (*rig.acquiring, rig.arm):
        assert isinstance(device, protocols.Device)
    assert isinstance(rig.counter, protocols.QuadratureCounter | protocols.Latched | protocols.Polled)
    for shape in (
        protocols.AnalogInput,
        protocols.TriggerInput,
        protocols.DigitalOutput,
        protocols.AnalogOutput,
        protocols.Latched,
    ):
        assert isinstance(rig.analog, shape)
    assert isinstance(rig.tracker, protocols.PositionTracker) and isinstance(rig.tracker, protocols.Latched)
    assert not isinstance(make_rig(tracker={"stream": 0}).tracker, protocols.Latched)
    assert isinstance(rig.arm, protocols.ArmController)
    assert isinstance(FastClock(), protocols.HostClock)


@pytest.mark.parametrize(("rate", "source"), [(1000.0, EdgeSource.TRACKER), (20e3, EdgeSource.TIMER)])
def test_a_row_of_every_device_for_each_edge(rate: float, source: EdgeSource) -> None:
    rig = make_rig()
    begin(rig, rate, source)
    blocks = read_for(rig, 1.0)
    rows = round(rate)
    for name in ("counter", "analog", "edges"):
        assert len(blocks[name]) == rows, name
        assert (blocks[name].number == np.arange(rows)).all()
        assert (np.diff(blocks[name].host) > 0).all()
    assert len(blocks["tracker"]) == 1000
    late = blocks["counter"].host - rig.world.line.times(blocks["counter"].number)
    assert late.min() >= 0 and late.max() < 50_000


def test_counts_and_volts_and_points_are_those_of_the_motion() -> None:
    rig = make_rig()
    begin(rig)
    demand = demand_of(chirps())
    blocks = read_for(rig, 3.0)
    t = rig.world.line.times(blocks["counter"].number) * 1e-9 - rig.world.epoch_ns() * 1e-9
    q = demand(t)
    for joint in (0, 1):
        counts = extend(blocks["counter"].counts[:, joint], 24, int(blocks["counter"].counts[0, joint]))
        error = counts - PER_RADIAN[joint] * (q[:, joint] - q[0, joint])
        assert np.ptp(error) < 1.3, "one count, and the hysteresis"
        # 20 ... 0.5 V/A of ten turns, converted after the channel's place in the scan
        ideal = 0.5 * current_of(demand, t + joint * 4e-6)[:, joint]
        within = np.abs(ideal) < 9.9
        error = (blocks["analog"].volts[:, joint] - ideal)[within]
        step = 20 / 4096
        assert abs(error.mean()) < 0.1 * step
        # converter, its noise, the transducer's, and lines between steps of a curved current
        assert np.sqrt(step**2 / 12 + 1e-3**2 + 3e-3**2) == pytest.approx(error.std(), rel=0.1)
        saturated = blocks["analog"].quality[:, joint] == Quality.SATURATED
        assert saturated[np.abs(ideal) > 10.02].all() and not saturated[within].any()
    error = blocks["tracker"].points - (np.column_stack([q[:, 0], 0 * t, 0 * t]) + [0.05, 0.0, 0.10])
    assert np.sqrt((error**2).sum(axis=1).mean()) == pytest.approx(1e-4, rel=0.1)
    assert np.abs(error.mean(axis=0)).max() < 1e-5


def test_samples_do_not_depend_on_how_time_is_cut_or_who_else_looks() -> None:
    results = []
    for block, alone in ((0.01, False), (0.137, False), (0.5, True)):
        rig = make_rig(seed=4)
        rig.world.clock.sleep(0.003 * len(results))
        begin(rig)
        if alone:
            rig.world.clock.sleep(2.74)
            results.append({"counter": rig.counter.read()})
        else:
            results.append(read_for(rig, 2.74, block))
    first, second, alone = results
    assert (alone["counter"].counts == first["counter"].counts).all()
    for name in first:
        assert len(first[name]) == len(second[name]) or name == "tracker"
        for part in ("counts", "volts", "points", "quality"):
            one, other = getattr(first[name], part), getattr(second[name], part)
            assert (one is None and other is None) or np.array_equal(one, other, equal_nan=part == "points")
    other_seed = make_rig(seed=5)
    begin(other_seed)
    assert (read_for(other_seed, 2.74)["analog"].volts != first["analog"].volts).any()


def test_modes_count_a_quarter_and_a_half() -> None:
    rig = make_rig()
    for channel, mode in enumerate(CounterMode):
        rig.counter.configure(channel, mode)
    four = mit_c12.Card("second", mit_c12.Config(joints=[1, 2, 3, 0]), rig.world)
    four.open()
    begin(rig)
    four.arm(Plan(EdgeSource.TRACKER, 1000.0, None))
    blocks = read_for(rig, 2.0)
    counts = quadrature.wrap(four.read().counts + (1 << 23), 24) - (1 << 23)
    shown = quadrature.wrap(blocks["counter"].counts + (1 << 23), 24) - (1 << 23)
    for channel, share in enumerate((4, 2, 1)):
        moved = counts[:, channel] - counts[0, channel]
        assert np.abs((shown[:, channel] - shown[0, channel]) * share - moved).max() <= share


def test_register_wraps_presets_and_resets_at_the_index_pulse() -> None:
    rig = make_rig()
    rig.arm.load(chirps())
    rig.counter.preset(0, (1 << 24) - 3)
    rig.counter.preset(1, 7)
    assert rig.counter.poll().counts[0, :2].tolist() == [(1 << 24) - 3, 7]
    begin(rig)
    rig.counter.index_enable(0)
    assert rig.counter.index_seen(0) is None
    blocks = read_for(rig, 1.0)
    shown, moved = rig.counter.index_seen(0), blocks["counter"].counts[:, 0]
    assert shown is not None
    demand = demand_of(chirps())
    t = rig.world.line.times(blocks["counter"].number) * 1e-9 - rig.world.epoch_ns() * 1e-9
    turns = np.floor(GEAR[0] * demand(t)[:, 0] / (2 * np.pi))
    pulse = int(np.argmax(turns != turns[0]))
    after = quadrature.wrap(moved[pulse:] + (1 << 23), 24) - (1 << 23)
    zero = GEAR[0] * demand(t[pulse:])[:, 0] * 1000 / (2 * np.pi)
    assert np.ptp(after - zero) < 1.3 and abs(round((after - zero).mean() / 1000) * 1000 - (after - zero).mean()) < 1.5
    # gear 1 is negative and the joint moves forwards first: the register wraps downwards from near its top
    assert moved[0] > 1 << 23


def test_tracker_keeps_what_it_has_room_for_and_streams_what_its_link_carries() -> None:
    rig = make_rig(tracker={"stream": 350.0, "memory": 1000})
    assert len(rig.tracker.recall()) == 0
    begin(rig)
    sent = read_for(rig, 3.0)["tracker"]
    assert len(sent) == 3000
    there = ~np.isnan(sent.points[:, 0])
    assert there.sum() == 1000 and there[::3].all()
    assert (sent.quality[~there] == Quality.MISSING).all() and (sent.quality[there] == 0).all()
    kept = rig.tracker.recall()
    assert len(kept) == 1000 and (kept.number == np.arange(1000)).all() and not np.isnan(kept.points).any()
    assert np.array_equal(kept.points[::3], sent.points[:1000:3])


def test_memory_outlasts_what_the_world_remembers() -> None:
    """Nobody reads the tracker before the end of a run longer than the signals are held."""
    rig = make_rig(tracker={"stream": 0.0})
    begin(rig, motion=chirps(26.0))
    read_for(rig, 26.0, 0.1)
    rig.analog.write_line("start", False)
    rig.tracker.disarm()
    kept = rig.tracker.recall()
    assert len(kept) == 1000 and not np.isnan(kept.points).any()


def test_lost_and_extra_edges_shift_the_numbers_and_lost_rows_leave_a_gap() -> None:
    faults = (
        LostEdge(device="counter", number=100, count=2),
        ExtraEdge(device="analog", number=200),
        LostRow(device="tracker", number=300, count=5),
    )
    rig, whole = make_rig(faults=faults), make_rig()
    begin(rig)
    begin(whole)
    blocks, truth = read_for(rig, 0.5), read_for(whole, 0.5)
    counter, analog, tracker = (blocks[name] for name in ("counter", "analog", "tracker"))
    assert (counter.number == np.arange(498)).all()
    assert np.rint(np.diff(counter.host)[99] * 1e-6) == 3
    assert (counter.counts == np.delete(truth["counter"].counts, [100, 101], axis=0)).all()
    assert (analog.number == np.arange(501)).all()
    assert np.rint(np.diff(analog.host)[200:202] * 1e-5).tolist() == [4, 6]
    assert (np.delete(analog.volts, 201, axis=0) == truth["analog"].volts).all()
    assert (np.diff(tracker.number)[[298, 299, 300]] == [1, 6, 1]).all() and len(tracker) == 495


def test_faults_of_channels() -> None:
    faults = (
        StuckChannel(device="analog", channel=0, at=0.2, back=0.4),
        StuckChannel(device="counter", channel=1, at=0.3),
        EmiCounts(device="counter", channel=0, at=0.1, counts=-40, noticed=True),
        DeviceReset(device="counter", at=0.6),
    )
    motion = _ramp()
    rig, whole = make_rig(faults=faults), make_rig()
    begin(rig, motion=motion)
    begin(whole, motion=motion)
    blocks, truth = read_for(rig, 1.0), read_for(whole, 1.0)
    volts, counts = blocks["analog"].volts, blocks["counter"].counts
    assert np.ptp(volts[199:399, 0]) < 0.03, "its own noise is all it shows"
    assert (volts[400:] == truth["analog"].volts[400:]).all()
    moved = quadrature.wrap(counts - truth["counter"].counts, 24)
    assert (moved[:99, 0] == 0).all() and (moved[99:598, 0] == (1 << 24) - 40).all()
    assert blocks["counter"].quality[99, 0] == Quality.QUADRATURE_ERROR
    assert np.ptp(counts[300:598, 1]) == 0
    assert (blocks["counter"].quality[599] & Quality.DEVICE_RESET).all()
    assert not (blocks["counter"].quality[600:]).any()
    assert counts[599, 1] == 0


def test_unplugged_device_says_so_and_misses_what_came_meanwhile() -> None:
    rig = make_rig(faults=(Unplugged(device="counter", at=0.3, back=0.5),))
    begin(rig)
    before = []
    for _ in range(29):
        rig.world.clock.sleep(0.01)
        before.append(len(rig.counter.read()))
    assert sum(before) == 290
    rig.world.clock.sleep(0.01)
    with pytest.raises(DeviceFault, match="counter: stopped answering"):
        rig.counter.read()
    rig.world.clock.sleep(0.3)
    block = rig.counter.read()
    assert block.number[0] == 290 and block.number[-1] == 399, "numbered by the edges that it saw"
    assert np.rint(np.diff(block.host).max() * 1e-6) == 201


def test_a_fault_injected_at_run_time_takes_hold_at_once() -> None:
    rig = make_rig()
    begin(rig)
    read_for(rig, 0.25)
    rig.world.inject(LostEdge(device="counter", number=255))
    blocks = read_for(rig, 0.1)
    assert (blocks["counter"].number == np.arange(250, 349)).all()
    assert np.rint(np.diff(blocks["counter"].host)[4] * 1e-6) == 2
    rig.world.inject(Unplugged(device="analog", at=0.0))
    with pytest.raises(DeviceFault):
        rig.analog.read()


def test_clock_drift_shows_in_ticks_and_edges() -> None:
    rig = make_rig(faults=(ClockDrift(device="tracker", ppm=200.0), ClockDrift(device="counter", ppm=-100.0)))
    begin(rig)
    block = read_for(rig, 2.0)["counter"]
    interval = (block.host[-1] - block.host[0]) / (len(block) - 1)
    assert interval == pytest.approx(1e6 * (1 - 200e-6), abs=30)
    rate = (block.tick[-1] - block.tick[0]) / ((block.host[-1] - block.host[0]) * 1e-9)
    assert rate == pytest.approx(1e6 * (1 - 100e-6), rel=2e-5)


def test_tracker_that_stops_early_and_broken_beams() -> None:
    faults = (TrackerStops(device="tracker", samples=700), BeamBreak(device="tracker", at=0.1, back=0.2))
    rig = make_rig(faults=faults)
    begin(rig)
    blocks = read_for(rig, 1.0)
    assert len(blocks["counter"]) == 700
    broken = np.isnan(blocks["tracker"].points).any(axis=1)
    assert broken.sum() == 100 and broken[99:199].all()
    assert (blocks["tracker"].quality[broken] == Quality.MISSING).all()


def test_stop_is_at_once_and_controlled() -> None:
    """Also though the motion was integrated ahead; the demand says what was really asked for."""
    motion, rig = _ramp(), make_rig()
    begin(rig, motion=motion)
    read_for(rig, 0.5)
    rig.arm.stop()
    assert not rig.arm.finished()
    blocks = read_for(rig, 1.0)
    assert rig.arm.finished()
    t = rig.world.line.times(blocks["counter"].number) * 1e-9 - rig.world.epoch_ns() * 1e-9
    q = rig.arm.demand(t)
    speed = np.diff(q[:, 0]) / 1e-3
    assert np.abs(np.diff(speed)).max() / 1e-3 < 8.1, "no faster than the ramps"
    assert abs(speed[-1]) < 1e-9 and q[-1, 0] == pytest.approx(motion.start[0] + 0.25 + 1.0**2 / 16, abs=0.2)
    counts = blocks["counter"].counts[:, 0].astype(float)
    counts = np.where(counts > 1 << 23, counts - (1 << 24), counts)
    assert np.ptp(counts - PER_RADIAN[0] * (q[:, 0] - q[0, 0])) < 1.5


def test_arm_waits_for_the_start_line_and_can_be_called_off() -> None:
    rig = make_rig()
    rig.arm.load(chirps())
    for device in (*rig.acquiring, rig.arm):
        device.arm(Plan(EdgeSource.TRACKER, 1000.0, None))
    rig.arm.start()
    rig.world.clock.sleep(1.0)
    assert len(rig.counter.read()) == 0 and not rig.arm.finished()
    rig.arm.stop()
    rig.analog.write_line("start", True)
    still = read_for(rig, 1.0)["counter"].counts
    assert len(still) == 1000 and np.ptp(still, axis=0).max() <= 1
    assert rig.arm.finished()


def test_refusals() -> None:
    rig = make_rig(analog={"conversion_rate": 83.3e3})
    with pytest.raises(DeviceFault, match="at most 10412"):
        rig.analog.arm(Plan(EdgeSource.TIMER, 20e3, None))
    with pytest.raises(DeviceFault, match="at most 1000 times per second"):
        rig.tracker.arm(Plan(EdgeSource.TRACKER, 1600.0, None))
    with pytest.raises(DeviceFault, match="for 2 joints"):
        rig.arm.load(chirps().model_copy(update={"start": [0.0, 0.0]}))
    with pytest.raises(DeviceFault, match="no channel 6"):
        rig.counter.preset(6, 0)
    with pytest.raises(DeviceFault, match="no line 'brake'"):
        rig.analog.write_line("brake", True)
    with pytest.raises(DeviceFault, match="-5 to 5 V"):
        rig.analog.write_volts(0, 7.0)
    rig.analog.write_volts(0, 3.0)
    rig.analog.safe()
    assert rig.analog.output == [0.0, 0.0]


@pytest.mark.parametrize("card", [mit_c12, lab_pc])
def test_a_card_wired_to_a_joint_that_is_not_there_is_refused(card: ModuleType) -> None:
    """The rig passed every check, and the first run ended in an IndexError."""
    context = RigContext()
    context.shared("sim_backend", lambda: make_rig().world)
    with pytest.raises(InputError, match="card1: joints: the arm has no joint 9; must be 1 to 6, or 0"):
        card.make("card1", card.Config(joints=[1, 2, 9, 0]), context)
    assert card.make("card1", card.Config(joints=[1, 2, 6, 0]), context).name == "card1"


def test_a_long_sleep_between_runs_costs_nothing_and_changes_no_count() -> None:
    rig = make_rig()
    begin(rig)
    read_for(rig, 3.5)
    at_end = rig.counter.poll().counts
    rig.world.clock.sleep(7 * 86400.0)
    assert np.abs(rig.counter.poll().counts - at_end).max() <= 1


def _ramp() -> Experiment:
    return chirps().model_copy(update={"segment": _drive(by=1.5)})


def _drive(by: float) -> list:
    from experiment.segments import Drive

    return [Drive(type="drive", joint=1, by=by, speed=0.5), Drive(type="drive", joint=2, by=by)]
