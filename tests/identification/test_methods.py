"""Methods beyond plain least squares: closed loop and friction tuning on a simulated arm, the SCARA joint by joint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.parameters import parameter, with_parameters
from arm_model.simulation.servo_references import Sampled
from arm_model.simulation.simulation import simulate
from arm_model.system.dynamics import inverse_dynamics
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from identification.identify import identify_by

TRUTH = {"link1.mass": 103.0, "joint1.viscous": 180.0, "joint1.coulomb": 25.0, "joint1.offset": 2.0}


@pytest.fixture(scope="module")
def drive(root: Path) -> Arm:
    """The EMPS axis with other numbers in it."""
    return with_parameters(read_model(root / "config/models/emps.toml"), TRUTH)


@pytest.fixture(scope="module")
def run(drive: Arm, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Its closed loop on two tones, encoder of 1 micrometre, 20 mV of noise on the output."""
    random = np.random.default_rng(2)
    t = np.arange(12_000) / 1000

    def demand(times: np.ndarray) -> np.ndarray:
        ease = np.clip(times, 0, 1) ** 3 * (10 - 15 * np.clip(times, 0, 1) + 6 * np.clip(times, 0, 1) ** 2)
        return (ease * (0.03 * np.sin(2.3 * times) + 0.008 * np.sin(11.0 * times)))[:, None]

    motion = simulate(drive, Sampled(demand), duration=12.0, rate=1000.0)
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    signals = {
        "q": np.rint(motion.qm[: len(t)] / 1e-6) * 1e-6,
        "i": motion.current[: len(t)] + 0.02 * random.standard_normal((len(t), 1)),
        "qref": demand(t),
    }
    write_table(path, t, signals, Attachments())
    return open_recording(path)


@pytest.mark.parametrize("method", ["wls", "iv", "didim", "sequence"])
def test_methods_agree_on_the_truth(method: str, drive: Arm, run: Recording, root: Path) -> None:
    start = read_model(root / "config/models/emps.toml")
    result = identify_by(method, [run], start)
    for value in result.base:
        # Stick-slip at reversals costs up to a percent of friction, beyond the stated deviation.
        assert abs(value.value - TRUTH[value.name]) < max(3 * value.std, 0.01 * abs(TRUTH[value.name])), value
        assert value.std < 0.05 * abs(TRUTH[value.name])
        assert np.isclose(parameter(result.arm, value.name), value.value, rtol=1e-3)


def test_friction_is_tuned_from_nothing(drive: Arm, run: Recording) -> None:
    bare = with_parameters(drive, {"joint1.viscous": 0.0, "joint1.coulomb": 0.0})
    result = identify_by("friction", [run], bare)
    found = {value.name: value.value for value in result.base}
    assert np.isclose(found["joint1.viscous"], TRUTH["joint1.viscous"], rtol=0.03)
    for direction in ("coulomb_positive", "coulomb_negative"):
        assert np.isclose(found[f"joint1.{direction}"], TRUTH["joint1.coulomb"], rtol=0.03)
    assert result.relative_error(False) < 0.2 * result.compared["the friction that the model came with"][0]


def test_friction_that_no_row_shows_stays_as_the_model_has_it(drive: Arm, run: Recording, tmp_path: Path) -> None:
    """A second axis, across the first, jumps once: that is no row of friction."""
    assert drive.controller is not None and run.qref is not None
    first = replace(drive.joints[0], alpha=np.pi / 2)
    gains = {name: 2 * getattr(drive.controller, name) for name in ("position_gain", "velocity_gain")}
    controller = replace(drive.controller, **gains)
    both = replace(drive, joints=(first, drive.joints[0]), controller=controller, gravity=(0.0, 0.0, 0.0))
    jump = 0.01 * np.clip((run.t - 6.0) / 0.02, 0.0, 1.0)
    columns = {name: np.column_stack([getattr(run, name)[:, 0], jump]) for name in ("q", "qref")}
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(run.t))
    write_table(tmp_path / "run.mcap", run.t, {**columns, "i": np.column_stack([run.i[:, 0], noise])}, Attachments())
    bare = with_parameters(both, {"joint1.viscous": 0.0, "joint1.coulomb": 0.0})
    result = identify_by("friction", [open_recording(tmp_path / "run.mcap")], bare)
    assert {value.name for value in result.base} == {
        f"joint1.{name}" for name in ("viscous", "coulomb_positive", "coulomb_negative")
    }
    assert parameter(result.arm, "joint2.viscous") == parameter(both, "joint2.viscous")


def test_friction_of_an_unstable_loop_is_refused_in_one_line(drive: Arm, run: Recording) -> None:
    assert drive.controller is not None
    gains = tuple(1e4 * gain for gain in drive.controller.velocity_gain or ())
    joints = tuple(replace(joint, torque_limit=None) for joint in drive.joints)
    wild = replace(drive, joints=joints, controller=replace(drive.controller, velocity_gain=gains))
    with pytest.raises(InputError, match="closed loop is unstable"):
        identify_by("friction", [run], wild)


def scara_run(arm: Arm, joint: int, elbow: float, folder: Path) -> Recording:
    """One joint moves, the others stand; torques by inverse dynamics, with some noise."""
    random = np.random.default_rng(joint)
    t = np.arange(10_000) / 500
    ease = np.clip(t / 2, 0, 1)
    ease = ease**3 * (10 - 15 * ease + 6 * ease**2)
    size = 0.1 if joint == 2 else 0.8
    q = np.tile([0.2, elbow, 0.1], (len(t), 1))
    q[:, joint] += ease * size * (np.sin(2.1 * t) + 0.4 * np.sin(5.3 * t))
    qd = np.gradient(q, t, axis=0)
    tau = inverse_dynamics(arm, q, qd, np.gradient(qd, t, axis=0))
    path = folder / f"joint{joint + 1}_{elbow}.mcap"
    write_table(path, t, {"q": q, "i": tau + 0.02 * random.standard_normal(tau.shape)}, Attachments())
    return open_recording(path)


def test_scara_link_after_link(root: Path, tmp_path: Path) -> None:
    nominal = read_model(root / "config/models/scara.toml")
    rubbing = replace(
        nominal, joints=tuple(replace(j, viscous=2.0, coulomb=(1.5, 1.5), sign_velocity=1e-3) for j in nominal.joints)
    )
    truth = with_parameters(rubbing, {"link2.izz": 0.4, "link2.mx": 0.2, "link3.mass": 3.0})
    start = with_parameters(rubbing, {"joint2.viscous": 1.0})
    # Joint 1 with the elbow blocked at three angles shows what joint 2 alone does not: link 2's first moment.
    runs = [scara_run(truth, joint, 0.7, tmp_path) for joint in range(3)]
    runs += [scara_run(truth, 0, elbow, tmp_path) for elbow in (-0.5, 1.9)]
    result = identify_by("sequence", runs, start)
    found = {value.name: value for value in result.base}
    # the third joint lifts: beside its weight a constant force cannot be distinguished
    assert abs(found["link3.mass + 0.101972 joint3.offset"].value - 3.0) < 0.01
    assert abs(found["joint2.viscous"].value - 2.0) < 0.02
    assert result.relative_error(False) < 0.005
    q, qd, qdd = np.random.default_rng(9).uniform(-1, 1, (3, 40, 3))
    off = inverse_dynamics(result.arm, q, qd, qdd) - inverse_dynamics(truth, q, qd, qdd)
    before = inverse_dynamics(start, q, qd, qdd) - inverse_dynamics(truth, q, qd, qdd)
    assert np.all(np.std(off, axis=0) < 0.05 * np.std(before, axis=0))
