"""The motor-link pair against scipy's integration of the same equation, with the figures of the thesis's table 5.1."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from arm_model.description import Arm, Joint
from daq.recording import open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from identification.methods.joint_by_joint import identify_joints
from identification.methods.motor_link import motor_link

INERTIA, VISCOUS, WEIGHT, FRICTION = 2.0950, 1.0, 9.3163, 2.0  # kg m2 about the axis, N m s/rad, N m, N m


def torque(t: float) -> float:
    """Three incommensurate tones, slow enough to move the link by a radian."""
    return 9.0 * np.sin(1.1 * t) + 6.0 * np.sin(2.7 * t) + 3.0 * np.sin(4.9 * t)


@pytest.fixture(scope="module")
def run() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t (n,), q (n,), torque (n,) of the pair that hangs down at q = 0, gravity torque M g l sin q."""

    def rate(t: float, x: np.ndarray) -> list[float]:
        friction = VISCOUS * x[1] + FRICTION * np.tanh(x[1] / 1e-3)
        return [x[1], (torque(t) - friction - WEIGHT * np.sin(x[0])) / INERTIA]

    t = np.arange(30_000) / 1000
    solution = solve_ivp(rate, (0, t[-1]), [0.0, 0.0], t_eval=t, method="Radau", rtol=1e-8, atol=1e-10)
    return t, solution.y[0], np.vectorize(torque)(t)


def given(gravity: bool = True) -> dict[str, float]:
    weight = {"gravity_sin": WEIGHT, "gravity_cos": 0.0} if gravity else {}
    friction = {"coulomb_positive": FRICTION, "coulomb_negative": FRICTION}
    return {"inertia": INERTIA, "viscous": VISCOUS, **weight, **friction}


@pytest.mark.parametrize("way", ["filter", "integral"])
def test_table_5_1_without_noise(run: tuple, way: str) -> None:
    found = motor_link(*run, way=way)
    for name, value in given().items():
        assert abs(found.value(name) - value) < 2e-3 * max(value, 1.0), name
    assert np.isclose(found.gravity, WEIGHT, rtol=1e-3)


@pytest.mark.parametrize("way", ["filter", "integral"])
def test_table_5_1_with_noise(run: tuple, way: str) -> None:
    t, q, tau = run
    random = np.random.default_rng(5)
    q = np.rint((q + 1e-5 * random.standard_normal(len(q))) / 1e-4) * 1e-4
    found = motor_link(t, q, tau + 0.1 * random.standard_normal(len(q)), way=way)
    # The thesis's own noisy estimates are up to 1 % off.
    for name, value in given().items():
        assert abs(found.value(name) - value) < 0.01 * max(value, 2.0), name


def test_either_direction_has_its_own_friction(run: tuple) -> None:
    t, q, tau = run
    found = motor_link(t, q, tau + 0.5)  # a constant torque more is half a newton metre more forwards, less backwards
    assert np.isclose(found.value("coulomb_positive"), FRICTION + 0.5, atol=0.01)
    assert np.isclose(found.value("coulomb_negative"), FRICTION - 0.5, atol=0.01)


def test_without_gravity() -> None:
    t = np.arange(20_000) / 1000
    w = 1.3
    q, v, a = 1 - np.cos(w * t), w * np.sin(w * t), w**2 * np.cos(w * t)
    found = motor_link(t, q, INERTIA * a + VISCOUS * v + FRICTION * np.sign(v), gravity=False)
    assert found.names == ("inertia", "viscous", "coulomb_positive", "coulomb_negative")
    for name, value in given(gravity=False).items():
        assert abs(found.value(name) - value) < 0.01 * value, name


def test_run_in_one_direction_says_nothing_of_the_other(tmp_path: Path, root: Path) -> None:
    arm = Arm(name="wheel", joints=(Joint(mass=1.0, inertia=(1.0, 1.0, 1.0, 0, 0, 0)),))
    recordings = []
    for name, way in (("there", 1.0), ("back", -1.0)):
        t = np.arange(4_000) / 1000
        s = np.clip((t - 0.8) / 2.4, 0, 1)
        q = way * np.pi * s**3 * (10 - 15 * s + 6 * s**2)
        v = np.gradient(q, t)
        friction = np.where(v > 0, 3.0, 5.0) * np.sign(v) * (np.abs(v) > 1e-6)
        tau = 2.0 * np.gradient(v, t) + 1.5 * v + friction
        write_table(tmp_path / f"{name}.mcap", t, {"q": q[:, None], "i": tau[:, None]}, Attachments())
        recordings.append(open_recording(tmp_path / f"{name}.mcap"))
    one = {value.name: value for value in identify_joints(recordings[:1], arm).parameters}
    assert not one.get("joint1.coulomb_negative") or not one["joint1.coulomb_negative"].identifiable
    assert np.isclose(one["joint1.coulomb_positive"].value, 3.0, atol=0.05)
    both = {value.name: value.value for value in identify_joints(recordings, arm).parameters}
    assert np.isclose(both["joint1.coulomb_positive"], 3.0, atol=0.05)
    assert np.isclose(both["joint1.coulomb_negative"], 5.0, atol=0.05)
    assert np.isclose(both["joint1.viscous"], 1.5, atol=0.05)
