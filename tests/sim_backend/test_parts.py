"""Noise by index, history of rows, trigger lines."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from arm_io import DeviceFault, InputError
from arm_model import Controller, read_model, write_model
from arm_model.urdf import write_urdf
from experiment import read_experiment
from sim_backend.arm.arm_motion import Servoed
from sim_backend.arm.history import History
from sim_backend.arm.plant import Drives, read_arm
from sim_backend.electronics import noise
from sim_backend.rig.faults import ExtraEdge, LostEdge, LostRow
from sim_backend.rig.trigger_line import TriggerLine, seen
from tests.conftest import ROOT


def test_servos_are_the_arms_own_where_the_rigs_model_has_no_controller(tmp_path: Path) -> None:
    """A URDF file has none; the motion on the wires must be that of the arm alone."""
    model = ROOT / "config/models/puma560.toml"
    urdf = tmp_path / "arm.urdf"
    write_urdf(urdf, read_model(model))
    experiment = read_experiment(ROOT / "config/experiments/excitation.toml")
    alone, beside = (
        read_arm(model, known, Drives(), 0.1).moving(experiment).advance() for known in (None, tmp_path / "arm.urdf")
    )
    assert np.array_equal(alone.motor, beside.motor) and np.array_equal(alone.current, beside.current)


def test_noise_is_normal_white_and_unrelated_between_streams() -> None:
    index = np.arange(200_000)[:, None]
    first, second = noise.normals(noise.keys(1, "a", 3), index, 2)
    other = noise.normals(noise.keys(1, "b", 3), index, 1)[0]
    for values in (first, second, other):
        for column in values.T:
            assert stats.kstest(column[::10], "norm").pvalue > 1e-3
            assert abs(np.corrcoef(column[1:], column[:-1])[0, 1]) < 0.01
    together = np.corrcoef(np.hstack([first, second, other]).T) - np.eye(9)
    assert np.abs(together).max() < 0.01
    assert abs(first.std() - 1) < 0.005 and np.abs(first).max() < noise.LARGEST


def test_noise_depends_on_its_index_alone() -> None:
    key = noise.keys(7, "x", 2)
    whole = noise.normals(key, np.arange(1000)[:, None], 4)
    some = np.array([999, 3, 3, 500])
    for all_of_it, part in zip(whole, noise.normals(key, some[:, None], 4)):
        assert (all_of_it[some] == part).all()


def test_uniforms_are_uniform() -> None:
    drawn = noise.uniforms(noise.keys(3, "u", 1), np.arange(20_000)[:, None])[:, 0]
    assert stats.kstest(drawn, "uniform").pvalue > 1e-3


@given(blocks=st.lists(st.integers(0, 30), max_size=40), keep=st.integers(1, 25))
def test_history_holds_the_newest_rows(blocks: list[int], keep: int) -> None:
    history, rows = History((2,), keep), np.empty((0, 2))
    for size in blocks:
        block = np.arange(2.0 * size).reshape(-1, 2) + rows.size
        history.append(block)
        rows = np.concatenate([rows, block])
    assert history.end == len(rows) and len(rows) - history.first >= min(keep, len(rows))
    held = np.arange(history.first, history.end)
    assert (history[held] == rows[held]).all()
    with pytest.raises(IndexError):
        history[np.array([history.end])]


@given(first=st.integers(0, 10**12), period=st.floats(2e4, 1e8), number=st.integers(0, 10**7), early=st.booleans())
def test_as_many_edges_were_made_as_have_passed(first: int, period: float, number: int, early: bool) -> None:
    line = TriggerLine(first, period)
    time = int(line.times(np.array([number]))[0])
    assert line.made(time - early) == number + (not early)
    assert TriggerLine(first, period, 5).made(time) == min(number + 1, 5)


def test_edges_as_they_are_seen_are_the_same_however_they_are_cut() -> None:
    line = TriggerLine(1000, 1e6)
    faults = [LostEdge(device="d", number=7, count=3), ExtraEdge(device="d", number=12), LostRow(device="d", number=13)]
    whole = seen(line, faults, 0, 30, 0)
    assert whole.number.tolist() == list(range(28)) and whole.missed.nonzero()[0].tolist() == [13]
    assert whole.edge[:12].tolist() == [0, 1, 2, 3, 4, 5, 6, 10, 11, 12, 12, 13]
    for cut in range(1, 29):
        head = seen(line, faults, 0, cut, 0)
        tail = seen(line, faults, cut, 30, len(head.edge))
        assert np.concatenate([head.time, tail.time]).tolist() == whole.time.tolist()
        assert np.concatenate([head.number, tail.number]).tolist() == whole.number.tolist()


def test_what_a_urdf_file_lacks_comes_from_the_rig_file(tmp_path: Path) -> None:
    """Encoders, gears, rotors and servos of the rig: a gantry of URDF moves as the one whose model says all."""
    arm = read_model(ROOT / "config/models/gantry.toml")
    even = replace(arm, joints=tuple(replace(joint, coulomb=(0.03, 0.03)) for joint in arm.joints))
    write_model(tmp_path / "arm.toml", even)
    write_urdf(tmp_path / "arm.urdf", even)
    drives = Drives(
        gears=tuple(joint.gear for joint in arm.joints),
        counts=tuple(4 * (joint.encoder_lines or 0) * joint.gear / (2 * np.pi) for joint in arm.joints),
        controller=arm.controller,
        rotors=tuple(joint.rotor_inertia for joint in arm.joints),
    )
    whole = read_arm(tmp_path / "arm.toml", None, Drives(), 0.1)
    bare = read_arm(tmp_path / "arm.urdf", tmp_path / "arm.urdf", drives, 0.1)
    np.testing.assert_allclose(bare.encoder_lines, whole.encoder_lines)
    experiment = read_experiment(ROOT / "config/experiments/arms/gantry_fit.toml")
    told, found = (plant.moving(experiment).advance() for plant in (whole, bare))
    # a URDF file has no smoothing velocity, so friction turns over more slowly
    np.testing.assert_allclose(found.motor, told.motor, atol=2e-3 * np.abs(told.motor).max())
    scale = whole.arm.joint_array("drive_constant")  # of the bare one 1: its currents are forces
    np.testing.assert_allclose(found.current[:3], told.current[:3] * scale, atol=1e-9)


@pytest.mark.parametrize(
    ("drives", "error"),
    [
        (Drives(), "has no [controller]"),
        (Drives(controller=read_model(ROOT / "config/models/gantry.toml").controller), "encoder_lines: is missing"),
        (Drives(controller=read_model(ROOT / "config/models/puma560.toml").controller), "controller.natural_frequency"),
        (
            Drives(controller=read_model(ROOT / "config/models/gantry.toml").controller, rotors=(1.0,)),
            "rotor_inertia: has 1 entries for 3 joints",
        ),
    ],
)
def test_what_neither_file_says_is_asked_for(tmp_path: Path, drives: Drives, error: str) -> None:
    write_urdf(tmp_path / "arm.urdf", read_model(ROOT / "config/models/gantry.toml"))
    with pytest.raises(InputError, match=re.escape(error)):
        read_arm(tmp_path / "arm.urdf", None, drives, 0.1)


def test_an_arm_that_cannot_be_simulated_is_a_device_that_failed(root: Path) -> None:
    """The wrist of a URDF file without rotors: a servo for tonnes throws its grams about, without bounds."""
    arm = read_model(root / "config/models/ur5e.urdf")
    free = tuple(replace(joint, coulomb=(0.0, 0.0), torque_limit=None) for joint in arm.joints)
    controller = Controller(kind="gains", position_gain=(100.0,) * 6, velocity_gain=(1e4,) * 6)
    experiment = read_experiment(root / "config/experiments/arms/ur5e_fit.toml")
    mover = Servoed(replace(arm, joints=free, controller=controller), experiment, 0.1)
    with pytest.raises(DeviceFault, match="rotor inertia"):
        for _ in range(80):
            mover.advance()
