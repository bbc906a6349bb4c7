"""The VAL terminal through a pty, with an arm behind it that moves in trapezoids."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from arm_io import DeviceFault
from drivers import RigContext
from drivers.val_terminal import device as driver
from experiment import Experiment, demand_of
from experiment.file import read_experiment
from sim_backend.protocol import val_terminal as simulator
from sim_backend.protocol.wires import Wires
from tests.drivers.swing import counts, volts

SPEED = 4.0  # rad/s at 100 %


class StraightArm:
    """Six joints that go straight to where they are sent, at constant speed."""

    def __init__(self) -> None:
        self.since, self.start, self.target, self.fraction = 0, np.zeros(6), np.zeros(6), 1.0

    def position(self, at: int) -> NDArray[np.float64]:
        way = self.target - self.start
        furthest = np.abs(way).max()
        gone = (at - self.since) * 1e-9 * SPEED * self.fraction
        return self.target.copy() if gone >= furthest else self.start + way * gone / furthest

    def move(self, target: NDArray[np.float64], fraction: float, at: int) -> None:
        self.start, self.target, self.since, self.fraction = self.position(at), target, at, fraction

    def moving(self, at: int) -> bool:
        return not np.array_equal(self.position(at), self.target)

    def halt(self, at: int) -> None:
        self.start = self.target = self.position(at)


def experiment(*segments: dict[str, object], start: list[float] | None = None) -> Experiment:
    return Experiment.model_validate(
        {
            "name": "test",
            "start": start or [0.0] * 6,
            "full_speed": list(driver.Config.model_fields["full_speed"].default),
            "full_acceleration": [5.0] * 6,
            "segment": list(segments),
        }
    )


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[tuple[driver.ValTerminal, simulator.SimulatedVal, StraightArm]]:
    arm = StraightArm()
    where = driver.Config(
        port=str(tmp_path / "val"), sign=(1, -1, 1, 1, 1, 1), zero=(0, 0, 90, 0, 0, 0), answer_timeout=0.5
    )
    box = simulator.make("val", where, Wires(counts=counts, volts=volts, arm=arm))
    box.open()
    device = driver.make("val", where, RigContext())
    yield device, box, arm
    device.close()
    box.close()


def until_finished(device: driver.ValTerminal, seconds: float = 5.0) -> None:
    end = time.monotonic() + seconds
    while not device.finished():
        assert time.monotonic() < end, "the motion does not end"
        time.sleep(0.005)


def test_drives_holds_and_moves_as_typed(rig) -> None:
    device, box, arm = rig
    assert device.open().details["joints_deg"].split() == ["0.00", "0.00", "90.00", "0.00", "0.00", "0.00"]
    assert device.check() == []
    device.load(
        experiment(
            {"type": "hold", "duration": 0.1},
            {"type": "drive", "joint": 2, "by": 0.5, "speed": 0.5},
            {"type": "drive", "joint": 3, "to": -0.25},
            {"type": "move", "to": [0.1, 0.2, 0.3, 0, 0, 0], "speed": 0.25},
            start=[0.0, 0.0, 0.0, 0.0, 0.3, 0.0],
        )
    )
    assert arm.position(time.monotonic_ns())[4] == pytest.approx(0.3, abs=1e-4)  # it stands at the start pose
    begun = time.monotonic()
    device.start()
    until_finished(device)
    assert time.monotonic() - begun > 0.1
    assert box.entered[-4:] == [
        "DRIVE 2,-28.648,50",
        "DRIVE 3,-14.324,100",
        "DO SPEED 25",
        "DO MOVE #PPOINT(5.730,-11.459,107.189,0.000,0.000,0.000)",
    ]
    assert arm.position(time.monotonic_ns()) == pytest.approx([0.1, 0.2, 0.3, 0, 0, 0], abs=1e-4)


def test_stop_of_another_thread_ends_the_way_to_the_start_pose(rig) -> None:
    device, box, arm = rig
    device.open()
    begun = time.monotonic()
    with ThreadPoolExecutor(1) as other:
        loading = other.submit(device.load, experiment({"type": "hold", "duration": 0.1}, start=[3.0] + [0.0] * 5))
        while "DRIVE 1,171.887,20" not in box.entered or not arm.moving(time.monotonic_ns()):
            assert time.monotonic() < begun + 5 and not loading.done()
            time.sleep(0.01)
        device.stop()
        with pytest.raises(DeviceFault, match="was stopped"):
            loading.result(timeout=5)
    assert not arm.moving(time.monotonic_ns()) and 0 < arm.position(time.monotonic_ns())[0] < 2.9
    device.load(experiment({"type": "hold", "duration": 0.01}))  # and takes orders again
    assert arm.position(time.monotonic_ns()) == pytest.approx(np.zeros(6), abs=1e-4)


def test_stop_of_another_thread_beside_a_motion_that_is_watched(rig) -> None:
    device, _, arm = rig
    device.open()
    device.load(experiment({"type": "drive", "joint": 1, "by": 3.0, "speed": 0.1}))
    device.start()
    with ThreadPoolExecutor(1) as other:
        watching = other.submit(until_finished, device)
        time.sleep(0.1)
        device.stop()
        watching.result(timeout=5)
    assert not arm.moving(time.monotonic_ns()) and 0 < arm.position(time.monotonic_ns())[0] < 1.5


def test_stop_ends_a_motion_at_once(rig) -> None:
    device, _, arm = rig
    device.open()
    device.load(experiment({"type": "drive", "joint": 1, "by": 3.0, "speed": 0.1}))
    device.start()
    time.sleep(0.3)
    assert not device.finished()
    device.stop()
    assert device.finished() and not arm.moving(time.monotonic_ns())
    assert 0 < arm.position(time.monotonic_ns())[0] < 1.5
    device.load(experiment({"type": "hold", "duration": 0.01}))  # and takes orders again


@pytest.mark.parametrize(
    ("segment", "what"),
    [
        ({"type": "chirp", "joint": 1, "amplitude": 0.1, "frequency": 1, "to_frequency": 2, "duration": 2}, "'chirp'"),
        ({"type": "drive", "joint": 1, "by": 0.1, "speed": 0.333}, "per cent"),
        ({"type": "setpoints", "times": [0, 1], "positions": [[0] * 6, [1] * 6]}, "'setpoints'"),
    ],
)
def test_what_val_cannot_do_is_refused_before_anything_moves(rig, segment: dict[str, object], what: str) -> None:
    device, box, _ = rig
    device.open()
    box.entered.clear()
    with pytest.raises(DeviceFault, match=what):
        device.load(experiment(segment))
    assert box.entered == []


def test_a_command_the_controller_does_not_know(rig) -> None:
    device, _, _ = rig
    device.open()
    with pytest.raises(OSError, match=r"refused: \*Unknown"):
        device._command("FROBNICATE")
    assert device._where()[2] == 90.0


def test_noise_on_the_echo_is_typed_again_and_never_entered(rig) -> None:
    device, box, arm = rig
    device.open()
    random = np.random.default_rng(1)
    box.corrupt = lambda data: b"~" + data if len(data) == 1 and random.random() < 0.03 else data
    device.load(experiment({"type": "drive", "joint": 1, "by": 0.2}))
    device.start()
    until_finished(device)
    box.corrupt = lambda data: data
    assert arm.position(time.monotonic_ns())[0] == pytest.approx(0.2, abs=1e-4)
    assert device._session.retyped > 0 and "wrong echo" in device.check()[0]
    known = ("SPEED 100", "WHERE", "DRIVE 1,11.459,100", "")
    assert set(box.entered) <= set(known)


def test_a_controller_that_falls_silent_is_a_fault(rig) -> None:
    device, box, _ = rig
    device.open()
    box.corrupt = lambda data: b""
    with pytest.raises(DeviceFault, match="no answer to 'SPEED 100'"):
        device.load(experiment({"type": "hold", "duration": 0.1}))
    assert "controller on" in device.check()[0]


def test_a_pulled_cable_in_a_motion_is_a_fault(rig) -> None:
    device, box, _ = rig
    device.open()
    device.load(experiment({"type": "drive", "joint": 1, "by": 3.0, "speed": 0.1}))
    device.start()
    box.pull_cable()
    with pytest.raises(DeviceFault):
        for _ in range(100):
            device.finished()
            time.sleep(0.01)
    with pytest.raises(DeviceFault, match="emergency stop"):
        device.stop()


def test_the_22_tests_of_the_thesis_are_typed_and_driven(rig, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every one of them through the terminal, echo and prompt included, to where its demand ends (pauses left out)."""
    device, box, arm = rig
    monkeypatch.setattr(f"{__name__}.SPEED", 400.0)
    device.open()
    paths = sorted((root / "config" / "experiments").glob("thesis_*.toml"))
    assert len(paths) == 22
    for path in paths:
        wanted = read_experiment(path)
        device.load(wanted)
        assert arm.position(time.monotonic_ns()) == pytest.approx(wanted.start, abs=1e-4), path.name
        device._steps = [step for step in device._steps if step.commands]
        assert device._steps, path.name
        box.entered.clear()
        device.start()
        until_finished(device)
        assert all(line.startswith(("DRIVE ", "DO SPEED ", "DO MOVE #PPOINT(")) for line in box.entered)
        demand = demand_of(wanted)
        end = demand(np.array([demand.duration]))[0]
        assert arm.position(time.monotonic_ns()) == pytest.approx(end, abs=1e-4), path.name
