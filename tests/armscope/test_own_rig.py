"""``armscope init --model``: a simulated rig of any arm, whose files fit each other, and which records."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model import Arm, Joint, read_model, write_model
from arm_model.rigid_body import regeared
from arm_model.system import inverse_dynamics
from armscope.cli import run
from armscope.own_rig.assumed_drives import TURNING, with_drives
from daq.recording import open_recording
from daq.rig.preflight import check_motion
from daq.rig.rig_file import read_rig
from experiment import read_experiment
from tests.arm_model.random_arms import random_arm
from tests.sim_backend.recordings import record


@pytest.mark.parametrize("model", ["examples/own_arm/arm.urdf", "config/models/ur5e.urdf", "config/models/scara.toml"])
@pytest.mark.parametrize("torques", [False, True])
def test_every_file_fits_every_other(root: Path, tmp_path: Path, model: str, torques: bool) -> None:
    folder = tmp_path / "my arm"
    assert run(["init", str(folder), "--model", str(root / model), *["--torques"] * torques]) == 0
    rig, arm = read_rig(folder / "rig.toml"), read_model(folder / "model.toml")
    assert rig.name == "my_arm" and rig.model_path == folder / "model.toml"
    assert [joint.type for joint in rig.joint] == [joint.type for joint in read_model(root / model).joints]
    assert [joint.gear for joint in rig.joint] == [joint.gear for joint in arm.joints]
    assert check_motion(rig, read_experiment(folder / "experiments/first_move.toml")) == []
    units = [joint.current.unit for joint in rig.joint if joint.current]
    assert units == [joint.command_unit for joint in arm.joints]
    assert set(units) <= ({"N m", "N"} if torques else {"A"})
    (target,) = {
        line
        for line in (folder / "rig.toml").read_text().splitlines()
        if line.startswith("target = ") and "#" not in line
    }
    assert len(target) < 60, "numbers as a person would write them"
    assert rig.limits.current is not None
    for joint, limit, unit in zip(arm.joints, rig.limits.current, rig.simulation["transducer"]["turns"]):
        assert joint.torque_limit is not None
        assert limit == pytest.approx(1.1 * joint.torque_limit / joint.drive_constant, rel=0.01)
        assert limit * unit < 1.05 * rig.simulation["transducer"]["rated_current"], "the transducer would saturate"


def test_random_arms_get_drives_that_carry_and_move_them() -> None:
    for seed in range(8):
        arm = random_arm(seed)
        bare = replace(arm, joints=tuple(replace(joint, gear=1.0, torque_constant=1.0) for joint in arm.joints))
        driven, told = with_drives(bare)
        assert told[-1].startswith("controller: ") and len(told) <= len(arm) + 2
        q = np.random.default_rng(1).uniform(-1, 1, (50, len(arm)))
        still = np.zeros_like(q)
        weight = np.abs(inverse_dynamics(replace(driven, controller=None), q, still, still)).max(axis=0)
        assert (weight < driven.joint_array("torque_limit")).all()


def test_a_drive_overcomes_the_friction_of_its_file() -> None:
    """Behind the last joint of a Jaco in MuJoCo is a milligram; with a drive for that, its simulation diverged."""
    flange = Joint(
        convention="placed", mass=1e-6, inertia=(1e-9,) * 3 + (0.0,) * 3, coulomb=(0.01,) * 2, viscous=(0.02,) * 2
    )
    driven, _ = with_drives(Arm(name="flange", joints=(flange,)))
    (joint,) = driven.joints
    assert joint.torque_limit is not None and joint.torque_limit > 0.01 + 0.02 * TURNING
    weak, told = with_drives(Arm(name="flange", joints=(replace(flange, torque_limit=0.005),)))
    assert weak.joints[0].torque_limit == joint.torque_limit
    assert "0.005 N m of the file cannot move it against 0.01 N m of weight and friction" in told[0]


def test_what_is_assumed_of_several_joints_is_said_once(root: Path) -> None:
    _, told = with_drives(read_model(root / "config/models/ur5e.urdf"))
    assert told[0] == "all joints: an encoder of 1000 lines"
    assert told[-2].startswith("joints 4 (wrist_1), 5 (wrist_2), 6 (wrist_3): 0.055 N m/A at the motor, rotor inertia")
    assert told[-1].startswith("controller: ") and len(told) == 6, "joints 1, 2 and 3 have a line each"


def test_a_complete_model_is_copied_as_it_stands(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = root / "config/models/gantry.toml"
    assert run(["init", str(tmp_path / "new"), "--model", str(source), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["assumed"] == []
    assert (tmp_path / "new/model.toml").read_text() == source.read_text()


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--torques"], "--torques: needs --model"),
        (["--like", "can", "--model", "arm.urdf"], "--model: makes a simulated rig"),
        (["--model", "none.urdf"], "none.urdf: "),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, arguments: list[str], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["init", str(tmp_path / "new"), *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: {error}")
    assert not (tmp_path / "new").exists()


def test_a_joint_that_moves_nothing_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = Arm(name="empty", joints=(Joint(type="prismatic"), Joint(mass=1.0)))
    write_model(tmp_path / "arm.toml", replace(empty, joints=(Joint(mass=1.0), Joint(type="prismatic"))))
    assert run(["init", str(tmp_path / "new"), "--model", str(tmp_path / "arm.toml")]) == 2
    assert "moves no mass" in capsys.readouterr().err


def test_another_gear_leaves_the_joint_as_it_was(root: Path) -> None:
    arm = read_model(root / "config/models/cylindrical.toml")
    other = replace(arm, joints=tuple(regeared(joint, -3.0 * joint.gear) for joint in arm.joints))
    q, qd, qdd = np.random.default_rng(1).standard_normal((3, 40, len(arm)))
    np.testing.assert_allclose(inverse_dynamics(other, q, qd, qdd), inverse_dynamics(arm, q, qd, qdd), rtol=1e-12)
    for before, after in zip(arm.joints, other.joints):
        assert after.drive_constant == pytest.approx(before.drive_constant)
        assert after.motor_speed_limit == pytest.approx(3.0 * (before.motor_speed_limit or 0.0))


def test_a_rig_of_torques_and_metres_records_in_their_units(root: Path, tmp_path: Path) -> None:
    """The whole chain of the cylindrical arm without motors: position from edges, force from the converter's codes."""
    arm = read_model(root / "config/models/cylindrical.toml")
    bare = replace(arm, joints=tuple(replace(regeared(joint, 1.0), encoder_lines=None) for joint in arm.joints))
    bare = replace(bare, joints=tuple(replace(joint, torque_constant=1.0) for joint in bare.joints))
    folder = tmp_path / "torques"
    write_model(tmp_path / "bare.toml", bare)
    assert run(["init", str(folder), "--model", str(tmp_path / "bare.toml"), "--torques"]) == 0
    motion = read_experiment(folder / "experiments/first_move.toml")
    (path,) = record(folder / "rig.toml", [motion], tmp_path)
    recording = open_recording(path)
    from daq.recording.summary import summary

    units = {f"{one['signal']}{one['joint']}": one["unit"] for one in summary(recording)["signals"]}
    assert [units[f"q{j}"] for j in (1, 2, 3, 4)] == ["rad", "m", "m", "rad"]
    assert [units[f"i{j}"] for j in (1, 2, 3, 4)] == ["N m", "N", "N", "N m"]
    assert recording.qref is not None
    assert np.nanmax(np.abs(recording.q - recording.qref)) < 0.02
    lift = recording.i[(recording.t > 0.3) & (recording.t < 0.5), 1]
    # what hangs at the lift while it stands; friction holds a part of it
    weight, friction = 9.80665 * sum(joint.mass for joint in arm.joints[1:]), max(arm.joints[1].rest_friction)
    assert abs(np.mean(lift) - weight) < friction
