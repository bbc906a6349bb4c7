"""Effects of a model in its identification.

Their parameters found together with the arm's own, in data that is written out here by hand.

The torques below follow from the textbook formulas of spring, load friction and uneven gear, not from the catalogue's
laws.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm, EffectTerm
from arm_model.model_file import read_model, write_model
from arm_model.rigid_body.numeric import rigid_torque
from armscope.cli import run
from daq.recording import open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from identification.methods import solution as steps
from identification.regression.effect_columns import repeated
from identification.regression.problem import prepare
from tests.arm_model.pumas import three_links

RATE, SECONDS = 250.0, 30.0
STIFFNESS, REST = 25.0, 0.4  # N m/rad at joint 2, slack at 0.4 rad
MU = 0.12  # of joint 2's load
RIPPLE, ORDER, PHASE = 8e-4, 1, 0.7  # rad at joint 3, cycles a motor turn
OFFSET = 0.35  # A at joint 1
LATE = 0.004  # s by which all currents are late


def motor_motion(t: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(m, 3) angle over gear, speed, acceleration: five harmonics of 0.1 Hz a joint, from rest."""
    rng = np.random.default_rng(seed)
    w = 2 * np.pi * 0.1 * np.arange(1, 6)
    a, b = rng.normal(size=(2, 3, 5)) * np.array([0.35, 0.3, 0.4])[:, None] / np.arange(1, 6) ** 0.7
    phase = w * t[:, None]
    q = np.cos(phase) @ a.T + np.sin(phase) @ b.T
    qd = -np.sin(phase) @ (a * w).T + np.cos(phase) @ (b * w).T
    qdd = -np.cos(phase) @ (a * w**2).T - np.sin(phase) @ (b * w**2).T
    return q + np.array([0.0, -0.5, 0.6]), qd, qdd


def currents(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """(m, 3) A of the motors of an arm with spring, load friction and an uneven gear."""
    ratio = arm.joints[2].ratio
    turn = ORDER * ratio * q[:, 2] + PHASE
    link, speed, acceleration = q.copy(), qd.copy(), qdd.copy()
    slope = 1 + RIPPLE * ORDER * ratio * np.cos(turn)
    link[:, 2] += RIPPLE * np.sin(turn)
    speed[:, 2] = slope * qd[:, 2]
    acceleration[:, 2] = slope * qdd[:, 2] - RIPPLE * (ORDER * ratio) ** 2 * np.sin(turn) * qd[:, 2] ** 2
    load = rigid_torque(arm, link, speed, acceleration)
    load[:, 1] += STIFFNESS * (link[:, 1] - REST)
    load[:, 2] *= slope
    torque = load.copy()
    for j, joint in enumerate(arm.joints):
        n = joint.ratio
        sign = qd[:, j] / np.hypot(qd[:, j], joint.sign_velocity)
        torque[:, j] += n**2 * (joint.rotor_inertia * qdd[:, j] + joint.viscous[0] * qd[:, j])
        torque[:, j] += n * (joint.coulomb[0] * sign + joint.offset)
        if j == 1:
            torque[:, j] += MU * np.abs(load[:, j]) * sign
    return torque / arm.joint_array("drive_constant")


def record(path: Path, arm: Arm, seed: int) -> Path:
    """Encoders of 1e-5 rad; currents late, offset at joint 1, with noise."""
    t = np.arange(int(RATE * SECONDS)) / RATE
    q, _, _ = motor_motion(t, seed)
    i = currents(arm, *motor_motion(t - LATE, seed))
    i[:, 0] += OFFSET
    i += 0.01 * np.random.default_rng(seed + 100).standard_normal(i.shape)
    write_table(path, t, {"q": np.round(q / 1e-5) * 1e-5, "i": i}, Attachments())
    return path


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    puma = three_links(read_model(root / "config/models/puma560.toml"))
    return replace(puma, controller=None, joints=tuple(replace(j, coulomb=sum(j.coulomb) / 2) for j in puma.joints))


TERMS = (
    EffectTerm("gravity_spring", 2, {"stiffness": 10.0, "rest_angle": REST}),
    EffectTerm("load_friction", 2, {"mu": 0.03}),
    EffectTerm("gear_ripple", 3, {"amplitude": 3e-4, "order": ORDER, "phase": PHASE}),
    EffectTerm("current_offset", 1, {"offset": 0.0}),
    EffectTerm("time_skew", None, {"delay": LATE}),
)
TRUTH = {
    "joint2.gravity_spring.stiffness": STIFFNESS,
    "joint2.load_friction.mu": MU,
    "joint3.gear_ripple.amplitude": RIPPLE,
}


def test_wrong_amplitudes_are_put_right(arm: Arm, tmp_path: Path) -> None:
    runs = [record(tmp_path / f"{name}.mcap", arm, seed) for seed, name in enumerate(("fit", "held_out"))]
    write_model(tmp_path / "model.toml", replace(arm, effects=TERMS))
    options = ["--model", str(tmp_path / "model.toml"), "--held-out", str(runs[1]), "--out", str(tmp_path / "out")]
    assert run(["identify", str(runs[0]), *options]) == 0
    result = json.loads((tmp_path / "out/identification.json").read_text())
    found = {p["name"]: p for p in result["parameters"]}
    for name, value in TRUTH.items():
        assert found[name]["identifiable"], name
        assert abs(found[name]["value"] - value) < 2 * found[name]["std"], (name, found[name])
        assert found[name]["std"] < 0.2 * value
    refined = {term.name: term.parameters for term in read_model(tmp_path / "out/model.toml").effects}
    assert refined["gear_ripple"]["amplitude"] == pytest.approx(RIPPLE, rel=0.1)
    assert refined["time_skew"]["delay"] == LATE
    assert result["relative_error"]["held_out"] < 0.01
    # What the current sensor of joint 1 shows at no current acts like a constant torque: only their sum can be known.
    assert not found["joint1.current_offset.offset"]["identifiable"]
    constant = next(p for p in result["base_parameters"] if p["expression"].startswith("joint1.offset"))
    waist = arm.joints[0]
    truth = waist.ratio * waist.offset + waist.drive_constant * OFFSET
    assert abs(constant["value"] - truth) < 2 * constant["std"]


def test_a_fit_that_does_not_settle_is_one_of_the_rows_that_it_goes_with(
    arm: Arm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows around its values are others, and may show more parameters than were fitted."""
    monkeypatch.setattr(steps, "STEPS", 1)
    recording = open_recording(record(tmp_path / "run.mcap", arm, 0))
    found = steps.solve(prepare([recording], replace(arm, effects=TERMS)), "wls", lambda _: None)
    left = found.residual(found.problem.rows)
    assert left == pytest.approx(found.best.residual, abs=1e-6)
    assert "did not converge" in found.problem.warnings[-1]
    # the trials of further terms share the warnings
    again = steps.solve(found.problem, "wls", lambda _: None)
    assert sum("did not converge" in warning for warning in again.problem.warnings) == 1


@pytest.mark.slow
def test_late_currents_are_moved_back_before_anything_is_fitted(arm: Arm, tmp_path: Path) -> None:
    path = record(tmp_path / "late.mcap", arm, 2)
    error = {}
    for delay in (LATE, 1e-5):
        terms = [replace(term, parameters={"delay": delay}) if term.name == "time_skew" else term for term in TERMS]
        write_model(tmp_path / "model.toml", replace(arm, effects=tuple(terms)))
        out = tmp_path / f"{delay}"
        assert run(["identify", str(path), "--model", str(tmp_path / "model.toml"), "--out", str(out)]) == 0
        error[delay] = json.loads((out / "identification.json").read_text())["relative_error"]["fit"]
    assert error[LATE] < 0.5 * error[1e-5]


def test_second_effect_of_a_name_is_said_to_be_held(arm: Arm) -> None:
    spring = EffectTerm("gravity_spring", 2, {"stiffness": STIFFNESS, "rest_angle": REST})
    assert repeated(replace(arm, effects=(spring,))) == []
    assert repeated(replace(arm, effects=(spring, spring, EffectTerm("load_friction", 2, {"mu": MU})))) == [
        "gravity_spring of joint 2"
    ]
