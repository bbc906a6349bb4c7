"""Coupled wrists in identification: friction of the joints' own axes, and couplings before a link without a mass.

The torques are those of the uncoupled arm's dynamics and of textbook friction, carried back by the transpose by hand.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model import Arm, Coupling, read_model
from arm_model.rigid_body import rigid_torque
from arm_model.rigid_body.numeric import drive_torque
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from identification.identify import identify_by
from identification.regression.base_parameters import structural_base
from identification.result import Identification, Value
from tests.arm_model.pumas import three_links
from tests.identification.test_effects import motor_motion

RATE, SECONDS = 200.0, 30.0
RATIO = 0.8
"""Of the turn of axis 3 by motor 2."""
VISCOUS, COULOMB = 1.5, 2.5
"""Friction of axis 3 itself, N m s/rad and N m."""


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    """The first three joints of the Puma, with the wrist's mass in the last link."""
    puma = three_links(read_model(root / "config/models/puma560.toml"))
    return replace(puma, controller=None, joints=tuple(replace(j, coulomb=sum(j.coulomb) / 2) for j in puma.joints))


def record(path: Path, arm: Arm, seed: int, ratio: float, viscous: float, coulomb: float) -> Recording:
    """A run of the arm whose motor 2 turns axis 3 by ``ratio``; encoders of 1e-5 rad, currents with noise."""
    t = np.arange(int(RATE * SECONDS)) / RATE
    motor = motor_motion(t, seed)
    c = np.eye(3)
    c[2, 1] = ratio
    q, qd, qdd = (each @ c.T for each in motor)
    load = rigid_torque(arm, q, qd, qdd)
    width = arm.joints[2].sign_velocity
    load[:, 2] += viscous * qd[:, 2] + coulomb * qd[:, 2] / np.hypot(qd[:, 2], width)
    torque = load @ c
    for j, joint in enumerate(arm.joints):
        n, v, a = joint.ratio, motor[1][:, j], motor[2][:, j]
        torque[:, j] += n**2 * (joint.rotor_inertia * a + joint.viscous[0] * v)
        torque[:, j] += n * (joint.coulomb[0] * v / np.hypot(v, joint.sign_velocity) + joint.offset)
    i = torque / arm.joint_array("drive_constant")
    i += 0.01 * np.random.default_rng(seed + 100).standard_normal(i.shape)
    write_table(path, t, {"q": np.round(motor[0] / 1e-5) * 1e-5, "i": i}, Attachments())
    return open_recording(path)


def values(found: Identification) -> dict[str, Value]:
    return {value.name: value for value in found.parameters}


def test_friction_of_an_axis_and_of_its_drive_are_found_apart(arm: Arm, tmp_path: Path) -> None:
    runs = [record(tmp_path / f"{k}.mcap", arm, k, RATIO, VISCOUS, COULOMB) for k in (0, 1)]
    last = replace(arm.joints[2], link_viscous=0.0, link_coulomb=0.0)
    start = replace(arm, joints=(*arm.joints[:2], last), coupling=(Coupling(3, 2, RATIO),))
    found = identify_by("wls", runs[:1], start, held_out=runs[1:], shape="straight")
    named, drive = values(found), arm.joints[2]
    truth = {
        "joint3.link_viscous": VISCOUS,
        "joint3.link_coulomb": COULOMB,
        "joint3.viscous": drive.ratio**2 * drive.viscous[0],
        "joint3.coulomb": drive.ratio * drive.coulomb[0],
    }
    for name, value in truth.items():
        assert named[name].identifiable, name
        assert abs(named[name].value - value) < 3 * (named[name].std or 0.0), name
        assert (named[name].std or 1.0) < 0.2 * value
    assert found.arm.joints[2].link_coulomb == pytest.approx(COULOMB, rel=0.1)
    assert found.relative_error(True) < 0.01


def test_without_couplings_only_the_sum_of_both_frictions_is_known(arm: Arm, tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", arm, 0, 0.0, VISCOUS, COULOMB)
    last = replace(arm.joints[2], link_viscous=0.5, link_coulomb=0.5)
    found = identify_by("wls", [run], replace(arm, joints=(*arm.joints[:2], last)), shape="straight")
    named, drive = values(found), arm.joints[2]
    assert not named["joint3.link_coulomb"].identifiable and "only in combination" in named["joint3.link_coulomb"].why
    whole = next(value for value in found.base if value.name == "joint3.coulomb + joint3.link_coulomb")
    assert abs(whole.value - drive.ratio * drive.coulomb[0] - COULOMB) < 3 * (whole.std or 0.0)


def massless(arm: Arm) -> Arm:
    """The arm whose model has no body behind the last joint."""
    flange = replace(arm.joints[-1], mass=0.0, com=(0.0, 0.0, 0.0), inertia=(0.0,) * 6)
    return replace(arm, joints=(*arm.joints[:-1], flange))


def test_a_link_that_the_model_has_as_massless_gets_the_body_that_the_data_show(arm: Arm, tmp_path: Path) -> None:
    runs = [record(tmp_path / f"{k}.mcap", arm, k, 0.0, 0.0, 0.0) for k in (0, 1)]
    found = identify_by("wls", runs[:1], massless(arm), held_out=runs[1:], shape="straight")
    assert found.relative_error(True) < 0.01
    assert found.arm.joints[2].mass > 0.3 * arm.joints[2].mass


def test_couplings_of_a_massless_link_are_not_said_to_move_nothing(root: Path) -> None:
    """Their columns are zero for the model's numbers, and for no arm whose link has a mass."""
    puma = massless(read_model(root / "config/models/puma560.toml"))
    found = structural_base(puma.with_effect("wrist_coupling", c54=0.0, c64=0.0, c65=0.0))
    assert {"wrist_coupling.c54", "wrist_coupling.c64", "wrist_coupling.c65"} <= {found.names[k] for k in found.kept}


@pytest.fixture(scope="module")
def wrist(root: Path) -> Arm:
    """The Puma with a load, whose wrist is coupled."""
    puma = read_model(root / "config/models/puma560.toml")
    load = replace(puma.joints[5], mass=2.0, com=(0.03, 0.01, 0.08), inertia=(0.012, 0.011, 0.006, 0.0, 0.0, 0.0))
    return replace(puma, joints=(*puma.joints[:5], load), controller=None)


def wrist_run(path: Path, arm: Arm, couplings: dict[str, float], noise: float) -> Recording:
    """30 s at 100 Hz; torques of the rigid links by C^T tau(C m), C written out here."""
    t = np.arange(3000) / 100.0
    three, more = motor_motion(t, 3), motor_motion(t, 4)
    motor = [np.concatenate([a, b], axis=1) for a, b in zip(three, more)]
    c = np.eye(6)
    for name, value in couplings.items():
        c[int(name[1]) - 1, int(name[2]) - 1] = value
    torque = rigid_torque(arm, *(each @ c.T for each in motor)) @ c
    torque += np.stack([drive_torque(j, motor[1][:, k], motor[2][:, k]) for k, j in enumerate(arm.joints)], axis=-1)
    i = torque / arm.joint_array("drive_constant")
    i += noise * np.random.default_rng(5).standard_normal(i.shape)
    write_table(path, t, {"q": np.round(motor[0] / 1e-5) * 1e-5, "i": i}, Attachments())
    return open_recording(path)


@pytest.mark.slow
def test_couplings_are_found_before_a_link_that_the_model_has_as_massless(wrist: Arm, tmp_path: Path) -> None:
    truth = {"c54": 0.05, "c64": -0.04, "c65": 0.1}
    run = wrist_run(tmp_path / "run.mcap", wrist, truth, 0.01)
    start = massless(wrist).with_effect("wrist_coupling", c54=0.0, c64=0.0, c65=0.0)
    found = identify_by("wls", [run], start, shape="straight")
    for name, value in truth.items():
        one = values(found)[f"wrist_coupling.{name}"]
        assert one.std is not None and abs(one.value - value) < 3 * one.std, name
    assert not any("settle" in warning or "not excited" in warning for warning in found.warnings)


@pytest.mark.slow
def test_a_coupling_of_which_nothing_is_known_is_not_called_identifiable(wrist: Arm, tmp_path: Path) -> None:
    """The flange alone, of 0.09 kg, and currents too noisy to show what its couplings do."""
    light = replace(
        wrist,
        joints=(
            *wrist.joints[:5],
            replace(wrist.joints[5], mass=0.09, com=(0.0, 0.0, 0.032), inertia=(1.5e-4, 1.5e-4, 4e-5, 0.0, 0.0, 0.0)),
        ),
    )
    run = wrist_run(tmp_path / "run.mcap", light, {"c54": 0.05, "c64": -0.04, "c65": 0.1}, 0.1)
    start = light.with_effect("wrist_coupling", c54=0.03, c64=-0.03, c65=0.05)
    found = identify_by("wls", [run], start, shape="straight")
    for name in ("c64", "c65"):
        one = values(found)[f"wrist_coupling.{name}"]
        assert (one.std or np.inf) > 0.1
        assert not one.identifiable and one.why
