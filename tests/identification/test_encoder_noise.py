"""Inertias of least squares where encoder noise is part of the acceleration, and warnings of several recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm, Joint
from armscope.api.identification import check
from armscope.cli import run
from identification.conclusion.conclude import _weak_in_words
from identification.preprocessing import attenuation
from identification.preprocessing.attenuation import attenuation_warnings, noise_in_acceleration
from identification.preprocessing.readiness import RunReadiness
from identification.preprocessing.run_warnings import said_once
from identification.preprocessing.signals import Motion, parallel_filter, smooth_motion
from identification.preprocessing.spectrum import choose_band

RATE, SECONDS = 500.0, 12.0
MODEL = """
name = "axis"
units = "SI"
[[joint]]
type = "prismatic"
convention = "placed"
xyz = [0.0, 0.0, 0.0]
axis = [1.0, 0.0, 0.0]
mass = 18.0
com = [0.0, 0.0, 0.0]
inertia = [0.2, 0.2, 0.2, 0.0, 0.0, 0.0]
"""


def axis(peak: float, step: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sliding mass of 20 kg with friction, known in closed form: t, q as an encoder of ``step`` m shows it, force.

    Slow sines of accelerations up to ``peak`` m/s2, and the shaking of their reversals up to 20 Hz, 40 dB below.
    """
    random = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, 1 / RATE)
    q, qd, qdd = np.zeros((3, len(t)))
    for frequency in (0.09, 0.17, 0.31, 0.43, *np.linspace(1.0, 20.0, 80)):
        w, phase = 2 * np.pi * frequency, random.uniform(0, 2 * np.pi)
        size = peak * (0.25 if frequency < 1 else 0.005)
        q -= size / w**2 * np.sin(w * t + phase)
        qd -= size / w * np.cos(w * t + phase)
        qdd += size * np.sin(w * t + phase)
    force = 20.0 * qdd + 30.0 * qd + 8.0 * np.tanh(qd / 1e-3) + random.normal(0, 0.05, len(t))
    return t, np.round(q / step) * step, force


def forced(t: np.ndarray, q: np.ndarray, force: np.ndarray) -> Motion:
    """The motion in a wide band, as reversals of a real servo make it."""
    q, force = q[:, None], force[:, None]
    return smooth_motion(t, q, force, band=replace(choose_band(q, 1 / RATE), motion=50.0, parallel=24.0))


def test_least_squares_make_an_inertia_too_small_by_the_share_of_noise() -> None:
    t, q, force = axis(0.5, 1e-4, 1)
    motion, clean = forced(t, q, force), forced(t, axis(0.5, 1e-12, 1)[1], force)
    share = noise_in_acceleration(motion)[0]
    assert 0.02 < share < 0.2 and noise_in_acceleration(clean)[0] < 1e-6
    for seen, missing in ((motion, share), (clean, 0.0)):
        signs = np.tanh(seen.qd / 1e-3)
        columns, torque = (
            parallel_filter(seen, one)[20:-20] for one in (np.hstack([seen.qdd, seen.qd, signs]), seen.torque)
        )
        mass = np.linalg.lstsq(columns, torque, rcond=None)[0][0, 0]
        assert 1 - mass / 20.0 == pytest.approx(missing, rel=0.3, abs=0.01)
    assert "joint 1 " in attenuation_warnings([motion])[0] and not attenuation_warnings([clean])


def test_identify_and_its_check_warn_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = []
    for seed in (1, 2):
        table = tmp_path / f"{seed}.csv"
        np.savetxt(table, np.c_[axis(0.5, 1e-4, seed)], delimiter=",", header="t,q1,i1", comments="")
        paths.append(tmp_path / f"{seed}.mcap")
        assert run(["import", str(table), "--out", str(paths[-1])]) == 0
    (tmp_path / "arm.toml").write_text(MODEL)
    arm = armscope.read_model(tmp_path / "arm.toml")
    monkeypatch.setattr(attenuation, "NOTABLE", 1e-9)
    result = armscope.identify(paths[0], arm, held_out=paths[1], shape="straight")
    for warnings in (result.warnings, check(paths[0], arm, held_out=paths[1]).warnings):
        assert any("encoder noise" in warning for warning in warnings)


def test_what_several_recordings_have_in_common_is_said_once() -> None:
    motion = forced(*axis(0.5, 1e-4, 1))
    runs = [
        RunReadiness(f"{name}.mcap", 1, 0.002, {}, [], [f"{name}.mcap: {words}" for words in said])
        for name, said in (("a", ["a row is lost", "it is slow"]), ("b", ["it is slow"]))
    ]
    said = [run.warnings for run in said_once(runs, [motion, motion], Arm(name="axis", joints=(Joint(),)))]
    assert said == [["a.mcap: a row is lost", "a.mcap, b.mcap: it is slow"], []]


def test_weak_speeds_of_friction_curves_are_counted() -> None:
    names = ["joint3.offset", "joint3.curve1", "joint3.curve2", "joint1.curve1+", *(f"link{k}.mx" for k in range(6))]
    assert _weak_in_words(names) == (
        "joint3.offset, link0.mx, link1.mx, link2.mx, link3.mx, link4.mx, ..., friction of joint 3 at 2 speeds of its "
        "curve, friction of joint 1 at 1 speed of its curve"
    )


@pytest.mark.parametrize("steps", [4096, 1_000_000])
def test_steps_of_a_coarse_encoder_are_no_motion(steps: int) -> None:
    """In slow moves steps of 1.5 mrad have a speed of their own, beyond the valley before them (125 Hz was let in)."""
    rng, dt = np.random.default_rng(0), 0.002
    t = np.arange(0.0, 14.0, dt)
    q = np.zeros((len(t), 3))
    for column in q.T:
        begin, place = 0.6, 0.0
        while begin < 13.0:
            seconds, goal = rng.uniform(1.0, 3.0), rng.uniform(-0.4, 0.4)
            part = np.clip((t - begin) / seconds, 0.0, 1.0)
            column += (goal - place) * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
            begin, place = begin + seconds, goal
    step = 2 * np.pi / steps
    band = choose_band(np.floor(q / step) * step, dt)
    assert band.motion < 50.0 and 2.0 < band.parallel < 5.0
