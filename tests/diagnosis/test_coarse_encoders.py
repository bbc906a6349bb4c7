"""Encoders of some thousand steps per turn: what their noise does in an inverse model is no effect of the arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_model import EffectTerm
from diagnosis import diagnose
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import KnownNoise, standstill
from diagnosis.residual.noise.instruments import Channels, band_of_angles
from diagnosis.residual.other_effects import residual_with
from diagnosis.residual.run import Run
from diagnosis.result import Diagnosis
from diagnosis.verification.encoder_noise import gain_from_encoder_noise
from tests.diagnosis import two_link
from tests.diagnosis.two_link import DRIVE, RATE, Day, motion, torque


@pytest.fixture
def _steps(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the encoders, per turn."""
    monkeypatch.setattr(two_link, "COUNTS", request.param)


def _diagnosed(folder: Path, root: Path, day: Day) -> Diagnosis:
    *fit, held_out = (two_link.recorded(folder / f"{seed}.mcap", seed, day) for seed in (1, 2, 3))
    return diagnose(two_link.model(root), fit, [held_out])


@pytest.mark.parametrize("_steps", [8000, 4096, 2000], indirect=True)
@pytest.mark.usefixtures("_steps")
def test_nothing_is_found_in_a_healthy_arm(tmp_path: Path, root: Path) -> None:
    """A soft gear smooths the noise of the accelerations; friction rises before the encoders show a motion."""
    result = _diagnosed(tmp_path, root, Day())
    assert result.verdict == "consistent" and not result.causes and not result.unexplained


@pytest.mark.parametrize("_steps", [4096, 2000], indirect=True)
@pytest.mark.usefixtures("_steps")
def test_friction_is_found_as_with_finer_encoders(tmp_path: Path, root: Path) -> None:
    """0.07 A: half of what steps of 1.5 mrad leave of a motion that is not smoothed, a quarter of those of 3 mrad."""
    (cause,) = _diagnosed(tmp_path, root, Day(coulomb=(0.7, 0.0))).causes
    (level,) = cause.parameters
    assert (cause.effect, cause.joint) == ("coulomb_friction", 1)
    assert abs(level.value - 0.7) < 2.0 * level.std < 0.1


@pytest.mark.parametrize(("_steps", "band"), [(4096, 12.0), (200_000, np.inf)], indirect=["_steps"])
@pytest.mark.usefixtures("_steps")
def test_angles_of_coarse_steps_are_smoothed_and_their_noise_is_what_is_left(root: Path, band: float) -> None:
    run = _run(root, two_link.COUNTS)
    assert run.angle_band == band
    usual = np.median(np.abs(run.residual[run.t > 2.0]), axis=0) / 0.6745
    assert np.all((0.6 * run.noise < usual) & (usual < 1.4 * run.noise))


@pytest.mark.parametrize(("tremor", "band"), [(0.01, np.inf), (0.0006, np.inf), (0.0001, 12.0)])
def test_a_motion_with_faster_parts_is_not_smoothed(root: Path, tremor: float, band: float) -> None:
    """A tremor of 0.01 rad at 16 Hz has ten times the acceleration of the steps; one of a ripple has 0.4 of a step."""
    assert _run(root, 4096, tremor=tremor).angle_band == band


def _run(root: Path, counts: int, tremor: float = 0.0) -> Run:
    (t, q, v, a), turn = motion(3, 12.0), 2 * np.pi * 16.0
    wave = tremor * np.sin(turn * t)[:, None]
    q, v, a = q + wave, v + tremor * turn * np.cos(turn * t)[:, None], a - turn**2 * wave
    current = torque(q, v, a, Day()) / DRIVE + 0.005 * np.random.default_rng(3).normal(size=q.shape)
    return residual_run("run", two_link.model(root), t, np.round(q * counts / 2 / np.pi) / counts * 2 * np.pi, current)


@pytest.mark.parametrize("_steps", [2000], indirect=True)
@pytest.mark.usefixtures("_steps")
def test_a_standstill_ends_before_the_arm_has_turned_by_more_than_noise(tmp_path: Path) -> None:
    """It turns by a step of 3 mrad in 0.1 s at first, less than the noise of its angle within a few rows."""
    recording = two_link.recorded(tmp_path / "slow.mcap", 1, Day())
    rows = standstill(recording)
    assert rows is not None
    _, q, _, _ = motion(1, 12.0)
    assert rows.start / RATE < 0.2 and rows.stop / RATE > 0.6
    assert np.abs(q[rows] - q[0]).max() < 2.0 * (2 * np.pi / 2000)


@pytest.mark.parametrize("interpolated", [False, True])
@pytest.mark.parametrize("_steps", [4096], indirect=True)
@pytest.mark.usefixtures("_steps")
def test_the_gain_of_a_spring_is_that_of_noise_and_the_gain_of_friction_is_not(root: Path, interpolated: bool) -> None:
    """Of angles that were interpolated, whose steps show no more, the recording's are known."""
    arm, (t, q, v, a), rng = two_link.model(root), motion(3, 12.0), np.random.default_rng(3)
    step = 2 * np.pi / two_link.COUNTS
    current = torque(q, v, a, Day(coulomb=(2.0, 0.0))) / DRIVE + 0.005 * rng.normal(size=q.shape)
    read = np.round(q / step) * step
    if interpolated:
        read[:-1] += rng.uniform(0.0, 0.5, (len(q) - 1, 1)) * np.diff(read, axis=0)
    run = residual_run("coarse", arm, t, read, current, known=KnownNoise(steps=np.full(2, step)))
    spring = EffectTerm("joint_compliance", 1, {"stiffness": 750.0, "damping": 10.0})
    friction = EffectTerm("coulomb_friction", 1, {"coulomb": 2.0})

    def gain(term: EffectTerm, *others: EffectTerm) -> float:
        energies = [np.sum(run.whiten(residual_with(run, terms)) ** 2) for terms in (others, (*others, term))]
        return float(energies[0] - energies[1])

    of_noise = gain_from_encoder_noise([run], [(friction,)], [(friction, spring)])
    assert gain(spring, friction) > 0.1 * len(run.t) and of_noise > 0.7 * gain(spring, friction)
    assert gain(friction) > 0.5 * len(run.t)
    assert gain_from_encoder_noise([run], [()], [(friction,)]) < 0.02 * gain(friction)


@pytest.mark.parametrize(("coarse", "band"), [(1, np.inf), (4, 12.0)])
def test_one_joint_with_coarse_steps_does_not_smooth_the_others(coarse: int, band: float) -> None:
    rng, t = np.random.default_rng(2), np.arange(0.0, 12.0, 1 / RATE)
    steps = np.where(np.arange(6) < coarse, 2e-3, 1e-5)
    q = 0.5 * np.sin(2 * np.pi * 0.3 * t[:, None] + np.arange(6))
    current, inertia = 0.01 * rng.normal(size=q.shape), np.broadcast_to(np.eye(6), (4, 6, 6))
    known = KnownNoise(steps=steps)
    assert band_of_angles(Channels(np.round(q / steps) * steps, current, inertia, RATE, known)) == band
