"""The guard: limits of the rig, and the safe state.

When the sampler hangs, a device is lost or the arm leaves its limits.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from arm_io import DeviceFault, InputError
from daq.acquisition.acquisition import Acquisition
from daq.acquisition.states import FAULTS, SENTENCES, End, Ending, State
from daq.rig.bench import Bench, open_bench
from daq.rig.rig_file import Rig
from experiment import Experiment
from tests.daq.benches import make_rig, run

ARM = {"name": "arm", "kind": "controller", "channels": 2}
OUTPUTS = {
    "start": {"device": "card", "line": "start"},
    "drive": {"device": "analog", "channel": 0, "limits": [-2.0, 2.0]},
}


def reach(to: float, speed: float = 1.0) -> Experiment:
    return Experiment.model_validate(
        {
            "name": "reach",
            "start": [0.0, 0.0],
            "full_speed": [2.0, 2.0],
            "full_acceleration": [20.0, 20.0],
            "segment": [{"type": "drive", "joint": 2, "to": to, "speed": speed}],
        }
    )


def _is_safe(bench: Bench) -> bool:
    return all(bench.devices[name].is_safe for name in ("card", "analog"))  # type: ignore[attr-defined]


@pytest.mark.parametrize("volts", [2.1, -7.0, float("nan"), float("inf")])
def test_volts_beyond_the_rigs_limits_do_not_reach_the_device(volts: float) -> None:
    with open_bench(make_rig(outputs=OUTPUTS)) as bench:
        bench.guard.set_volts("drive", 1.5)
        with pytest.raises(InputError, match=r"outputs.drive: .* V is outside -2 to 2 V"):
            bench.guard.set_volts("drive", volts)
        assert bench.devices["analog"].output == 1.5  # type: ignore[attr-defined]


def test_an_analogue_start_signal_goes_to_its_upper_limit_during_a_run() -> None:
    start = {"device": "analog", "channel": 0, "limits": [-1.0, 4.5]}
    with open_bench(make_rig(outputs={"start": start})) as bench:
        bench.guard.start(motion=False)
        assert bench.devices["analog"].output == 4.5  # type: ignore[attr-defined]
        bench.guard.make_safe()
        assert bench.devices["analog"].output == 0.0  # type: ignore[attr-defined]
    for limits in (None, [-5.0, 0.0]):
        with pytest.raises(ValueError, match=r"an analogue start signal needs 'limits' \[0, V\]"):
            make_rig(outputs={"start": {**start, "limits": limits}})


def test_outputs_are_known_by_name_and_kind() -> None:
    with open_bench(make_rig(outputs=OUTPUTS)) as bench:
        with pytest.raises(InputError, match="no such output in the rig file; there are: start, drive"):
            bench.guard.set_line("brake", True)
        with pytest.raises(InputError, match="give it volts"):
            bench.guard.set_line("drive", True)
        with pytest.raises(InputError, match="set it high or low"):
            bench.guard.set_volts("start", 1.0)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (
            {"position": [[-1, 1], [-0.4, 0.4]]},
            "joint 2 reaches 0.5 rad; its limits in the rig file are -0.4 to 0.4 rad",
        ),
        ({"speed": [3.0, 1.9]}, "joint 2 moves at up to 2 rad/s; its limit is 1.9 rad/s"),
    ],
)
def test_a_motion_beyond_the_rigs_limits_is_refused_before_anything_moves(limits: dict[str, Any], words: str) -> None:
    with open_bench(make_rig(more=[ARM], limits=limits)) as bench:
        acquisition = Acquisition(bench, reach(0.5))
        with pytest.raises(InputError, match=words):
            acquisition.arm()
        assert acquisition.state is State.IDLE
        assert bench.devices["arm"].experiment is None  # type: ignore[attr-defined]


def test_a_motion_for_another_arm_is_refused() -> None:
    three = {name: [1.0] * 3 for name in ("start", "full_speed", "full_acceleration")}
    motion = Experiment.model_validate({**reach(0.5).model_dump(), **three})
    with open_bench(make_rig(more=[ARM])) as bench, pytest.raises(InputError, match="for 3 joints, the rig has 2"):
        Acquisition(bench, motion).arm()


def _limited(limits: dict[str, Any]) -> Rig:
    return make_rig(more=[ARM], limits=limits)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"position": [[-1, 1], [-1, 0.1]]}, "joint 2 at 0.1"),
        ({"current": [0.5, 30.0]}, "current -0.5"),
        ({"speed": [0.1, 9.0]}, "joint 1 at 0.3"),
    ],
)
def test_an_arm_that_leaves_its_limits_is_stopped(limits: dict[str, Any], words: str) -> None:
    acquisition, rows = run(_limited(limits), seconds=5.0)
    assert rows is not None and len(rows) < 1000
    assert acquisition.state is State.FAULT
    assert acquisition.ending is not None and acquisition.ending.reason is End.LIMIT
    assert words in acquisition.ending.detail
    assert acquisition.ledger.imbalance() is None


def test_a_joint_that_was_never_zeroed_ends_the_run_at_once() -> None:
    rig = make_rig(more=[ARM])
    for joint in rig.joint:
        assert joint.encoder is not None
    table = rig.model_dump(mode="json")
    for joint in table["joint"]:
        joint["encoder"]["preset"] = None
    table["device"] = [{"name": d.name, "driver": d.driver, **d.options} for d in rig.device]
    motion = reach(0.5).model_copy(update={"start": [0.7, 0.0]})
    acquisition, _ = run(Rig.model_validate(table), experiment=motion)
    assert acquisition.ending is not None and acquisition.ending.reason is End.LIMIT
    assert "joint 1 reads" in acquisition.ending.detail and "zero the encoders" in acquisition.ending.detail


def test_a_consumer_that_hangs_trips_the_watchdog_on_the_real_clock() -> None:
    with open_bench(make_rig(own_time=False, outputs=OUTPUTS, watchdog=0.1, more=[ARM])) as bench:
        acquisition = Acquisition(bench, seconds=30.0)
        for number, _ in enumerate(acquisition.rows()):
            if number == 5:
                bench.guard.set_volts("drive", 1.0)
                deadline = time.monotonic() + 5.0
                arm: Any = bench.devices["arm"]
                while not (_is_safe(bench) and arm.stopped) and time.monotonic() < deadline:
                    time.sleep(0.01)  # the consumer hangs
                assert _is_safe(bench) and arm.stopped
                assert bench.guard.tripped is not None
        assert acquisition.ending is not None and acquisition.ending.reason is End.WATCHDOG
        with pytest.raises(DeviceFault, match="held safe: the sampler was not active"):
            bench.guard.set_volts("drive", 1.0)
        bench.guard.reset()
        bench.guard.set_volts("drive", 1.0)


def test_a_process_that_stood_still_does_not_go_on() -> None:
    """Sampler and watching thread wake up together, and the sampler gives its sign of life first."""
    with open_bench(make_rig(outputs=OUTPUTS, watchdog=60.0)) as bench:
        bench.guard.start(motion=False)
        bench.clock.sleep(59.0)
        bench.guard.feed()
        assert bench.guard.tripped is None and not _is_safe(bench)
        bench.clock.sleep(61.0)
        bench.guard.feed()
        assert bench.guard.tripped == "the sampler was not active for 60 s" and _is_safe(bench)


@pytest.mark.parametrize("fault", [{"gone_at": 100}, {"silent_at": 100}])
def test_a_lost_device_brings_the_outputs_to_their_safe_state(fault: dict[str, Any]) -> None:
    with open_bench(make_rig(analog=fault, outputs=OUTPUTS)) as bench:
        acquisition = Acquisition(bench, seconds=5.0)
        list(acquisition.rows())
        assert acquisition.state is State.FAULT
        assert _is_safe(bench)
        assert bench.devices["card"].high == {"start": False, "brake": False}  # type: ignore[attr-defined]


def test_a_bench_opens_and_closes_safe() -> None:
    bench = Bench(make_rig(outputs=OUTPUTS))
    bench.open()
    assert _is_safe(bench)
    bench.guard.set_line("start", True)
    bench.close()
    assert _is_safe(bench)
    bench.close()


def test_every_end_has_a_sentence() -> None:
    assert set(SENTENCES) == set(End)
    for end in End:
        ending = Ending(end, "card")
        assert str(ending).endswith("(card)")
        assert ending.state is (State.FAULT if end in FAULTS else State.DONE)


def test_speed_is_seen_from_the_measured_rows_and_a_value_marked_missing_is_no_breach() -> None:
    with open_bench(_limited({"speed": [1.0, 1.0], "current": [1.0, 1.0]})) as bench:
        host = np.arange(10) * 1_000_000
        still, all_of_them = np.zeros((10, 2)), np.ones((10, 2), bool)
        assert bench.guard.breach(still, still, host) is None
        assert bench.guard.breach(still * np.nan, still * np.nan, host, all_of_them) is None
        fast = np.outer(host * 1e-9, [0.5, 1.5])
        assert bench.guard.breach(fast, still, host) == "joint 2 at 1.5 rad/s, limit 1 rad/s"
        fast[[0, -1]], ends = np.nan, ~all_of_them
        ends[[0, -1]] = True
        assert bench.guard.breach(fast, still, host, ends) == "joint 2 at 1.5 rad/s, limit 1 rad/s"


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("limits", [{}, {"position": [[-1, 1], [-1, 1]]}, {"speed": [1.0, 1.0]}])
def test_a_position_that_is_not_finite_is_a_breach_whatever_the_limits(limits: dict[str, Any], wrong: float) -> None:
    with open_bench(_limited(limits)) as bench:
        host, position = np.arange(10) * 1_000_000, np.zeros((10, 2))
        for row in (0, 4, 9):
            seen = position.copy()
            seen[row, 1] = wrong
            assert str(bench.guard.breach(seen, position, host)).startswith(f"joint 2 at {wrong:g} rad, limits ")
        if np.isinf(wrong):
            assert "A in joint 1" in str(bench.guard.breach(position, position + [wrong, 0.0], host))
