"""Encoder steps that beat with the rows: noise of the size that is predicted, and no other noise elsewhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model import Arm
from arm_model.model_file import read_model
from arm_model.system import inverse_dynamics
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.remainder.against_noise import ratios
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.beats import beat_variance, steps_of
from diagnosis.residual.run import Run

RATE, COUNTS = 1000.0, 800


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return replace(read_model(root / "config/models/puma560.toml"), effects=())


def _step(arm: Arm) -> float:
    return 2 * np.pi / COUNTS / abs(arm.joints[1].ratio)


def _run(arm: Arm, per_row: float) -> Run:
    """Joint 2 passes about so many encoder steps per row, the others stand; nothing is wrong but the steps."""
    t = np.arange(int(6 * RATE)) / RATE
    # half a second at rest, then a speed that wanders by a thousandth
    speed = per_row * RATE * _step(arm) * np.clip((t - 0.5) / 0.3, 0.0, 1.0) * (1 + 1e-3 * np.sin(2.0 * t))
    rng = np.random.default_rng(3)
    q = np.zeros((len(t), len(arm)))
    q[:, 1] = np.cumsum(speed) / RATE - 1.0
    a = np.gradient(speed, 1 / RATE)
    v = np.zeros_like(q)
    v[:, 1] = speed
    current = inverse_dynamics(arm, q, v, np.where(np.arange(len(arm)) == 1, a[:, None], 0.0))
    current = current / arm.joint_array("drive_constant") + rng.normal(0.0, 1e-3, q.shape)
    read = q + rng.normal(0.0, 1e-9, q.shape)
    read[:, 1] = _step(arm) * np.floor(q[:, 1] / _step(arm))
    return residual_run("steps", arm, t, read, current)


@pytest.mark.parametrize(("per_row", "above_white"), [(1.012, 1.6), (0.988, 1.6), (2.013, 1.6), (1.507, 0.8)])
def test_a_beat_is_noise_of_the_size_that_its_rows_have(arm: Arm, per_row: float, above_white: float) -> None:
    """At 1.507 steps per row the second harmonic beats, of half the amplitude."""
    run = _run(arm, per_row)
    late = run.t > 1.2
    assert comparable_rows(run)[late, 1].all()
    actual = np.sqrt(np.mean(run.residual[late, 1] ** 2))
    assert actual > above_white * run.noise[1]
    stated = np.sqrt(np.mean(run.instruments[late, 1] ** 2))
    assert 0.7 * stated < actual < 1.3 * stated
    of_joint = next(one for one in ratios([run], dataset_of([run]).y) if one.joint == 2)
    assert of_joint.ratio < 1.3


def test_steps_that_do_not_beat_are_no_larger_than_white_noise(arm: Arm) -> None:
    run = _run(arm, 0.618)
    late = run.t > 1.2
    assert np.all(run.instruments[late, 1] == run.noise[1])
    assert np.sqrt(np.mean(run.residual[late, 1] ** 2)) < 1.1 * run.noise[1]


def test_an_angle_whose_noise_hides_its_steps_does_not_beat() -> None:
    rng = np.random.default_rng(5)
    q = np.sin(np.linspace(0.0, 3.0, 20000))[:, None] * np.ones(2)
    q[:, 1] += rng.normal(0.0, 1e-3, len(q))
    steps = steps_of(1e-4 * np.floor(q / 1e-4))
    assert steps[0] == pytest.approx(1e-4)
    assert steps[1] == 0.0


def test_harmonics_together_have_the_variance_of_a_step() -> None:
    """step^2 / 12 in all: six harmonics have nine tenths of it."""
    v = np.full((200, 1), 0.37)
    whole = beat_variance(v, np.array([1e-3]), 1000.0, lambda f: np.ones_like(f))
    assert 0.9 * 1e-6 / 12 < whole[50, 0] < 1e-6 / 12
