"""Rows with stamps of their own: a log whose sampling jitters is judged as one whose sampling does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.system import inverse_dynamics
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.diagnose import diagnose
from diagnosis.remainder.against_noise import against_noise
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import KnownNoise
from diagnosis.screening.even_rows import even, even_samples, grid_of, known_noise
from tests.comparison.second_day import motion, puma
from tests.diagnosis.one_axis import currents


def _recorded(path: Path, arm: Arm, seed: int, jitter: float, *, stamps_alone: bool = False) -> Recording:
    """15 s at 250 Hz; instants off by ``jitter`` periods (standard deviation), and stamped as they were.

    ``stamps_alone``: rows are even, their stamps are not.
    """
    rng = np.random.default_rng(seed)
    even = np.arange(3750) / 250.0
    t = even + jitter * np.clip(rng.normal(size=3750), -2, 2) / 250.0
    q, qd, qdd = motion(even if stamps_alone else t, len(arm), seed, 1.6)
    i = currents(arm, q, qd, qdd) + 0.01 * rng.standard_normal(q.shape)
    write_table(path, t - t[0], {"q": np.round(q / 1e-5) * 1e-5, "i": i}, Attachments())
    return open_recording(path)


def test_jitter_of_the_stamps_is_no_defect_of_the_arm(tmp_path: Path, root: Path) -> None:
    arm = puma(root, 2)
    runs = [_recorded(tmp_path / f"{seed}.mcap", arm, seed, 0.1) for seed in (1, 2, 3)]
    result = diagnose(arm, runs[:2], runs[2:])
    assert (result.verdict, [cause.key for cause in result.causes]) == ("consistent", [])


def test_signals_on_the_grid_are_those_of_its_instants(tmp_path: Path, root: Path) -> None:
    recording = _recorded(tmp_path / "run.mcap", puma(root, 2), 1, 0.1)
    (grid,) = even([recording])
    assert len(grid) == len(recording) and np.ptp(np.diff(grid.t)) < 1e-9
    exact = motion(grid.t + (recording.time[0] if recording.time is not None else 0.0), 2, 1, 1.6)[0]
    off = np.abs(grid.q - exact).max()
    assert off < 0.2 * np.abs(recording.q - exact).max()
    samples = even_samples((recording.t, recording.q, recording.i))
    np.testing.assert_array_equal(samples[1], grid.q)


@pytest.mark.parametrize("jitter", [0.005, 0.015])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_stamps_between_are_taken_if_the_angles_are_smoother_by_them(
    tmp_path: Path, root: Path, seed: int, jitter: float
) -> None:
    """Of three recordings of one log whose rows jitter by 2 % two were put onto the grid, and one was not."""
    right = _recorded(tmp_path / "right.mcap", puma(root, 2), seed, jitter)
    wrong = _recorded(tmp_path / "wrong.mcap", puma(root, 2), seed, jitter, stamps_alone=True)
    assert even([right])[0] is not right and even([wrong])[0] is wrong


def test_even_rows_and_torn_ones_are_left_alone(tmp_path: Path, root: Path) -> None:
    recording = _recorded(tmp_path / "run.mcap", puma(root, 2), 1, 0.0)
    assert even([recording])[0] is recording
    torn = np.delete(np.arange(100) + 0.1 * np.sin(np.arange(100)), slice(40, 44))
    # stamps of a clock that was fitted: 3 us rms at 1 kHz, the worst of ten thousand 30 us
    fitted = np.arange(10000) * 1e-3 + 3e-6 * np.random.default_rng(1).standard_normal(10000)
    fitted[5000] += 3e-5
    for t in (fitted, torn, np.arange(2.0)):
        # even rows of an encoder with steps of 10 urad
        assert grid_of(t, np.round(np.sin(1e-3 * np.arange(len(t))) / 1e-5)[:, None]) is None


def _floor(arm: Arm, rate: float, step: float, *, beat: bool = False, jitter: float = 0.1) -> Array:
    """(n,) error of the true arm over the stated noise, where each joint moves: encoders of ``step`` rad.

    ``beat``: at a speed of one step per row, all along.
    """
    rng, count = np.random.default_rng(1), int(15 * rate)
    t = (np.arange(count) + jitter * np.clip(rng.normal(size=count), -2, 2)) / rate
    q, qd, qdd = motion(t, len(arm), 1, 1.6)
    if beat:
        speed = 1.003 * step * rate
        q, qd, qdd = ((value[:, None] * np.ones(2)) for value in (speed * t, np.full(count, speed), np.zeros(count)))
    i = inverse_dynamics(arm, q, qd, qdd) / arm.joint_array("drive_constant") + 1e-3 * rng.standard_normal(q.shape)
    recorded = (t - t[0], np.round(q / step) * step, i)
    known = known_noise(recorded[0], recorded[1], KnownNoise())
    run = residual_run("jitter", arm, *even_samples(recorded), known=known)
    sure = comparable_rows(run) & (run.t > 1.0)[:, None]
    assert sure.any(axis=0).all()
    error, stated = (np.sqrt(np.mean(x**2, axis=0, where=sure)) for x in (run.residual, run.instruments))
    return np.asarray(error / stated, float)


@pytest.mark.parametrize("rate", [100.0, 250.0, 500.0])
@pytest.mark.parametrize("step", [1e-4, 2 * np.pi / 2**17, 2 * np.pi / 2**20])
def test_the_noise_floor_of_even_rows_is_that_of_the_steps(root: Path, rate: float, step: float) -> None:
    """It was 2 to 20 times too high for 2^17 counts per turn: a row moves by many of them."""
    ratio = _floor(puma(root, 2), rate, step, jitter=0.0)
    assert np.all((ratio > 0.6) & (ratio < 1.2)), ratio


@pytest.mark.parametrize("rate", [125.0, 250.0, 500.0])
@pytest.mark.parametrize("step", [1e-3, 1e-5])
def test_the_noise_floor_keeps_the_encoder_steps_that_a_grid_hides(root: Path, rate: float, step: float) -> None:
    """It was up to twenty times too high for fine encoders: angles on the grid change by what a row moves."""
    ratio = _floor(puma(root, 2), rate, step)
    assert np.all((ratio > 0.6) & (ratio < 1.2)), ratio


@pytest.mark.parametrize("rate", [125.0, 500.0])
def test_steps_that_beat_with_jittering_rows_are_in_the_noise_floor(root: Path, rate: float) -> None:
    """Without the steps it was 1.2 to 1.6 times too low. Jitter smears the beat, which is counted as without it."""
    ratio = _floor(puma(root, 2), rate, 1e-3, beat=True)
    assert np.all((ratio > 0.4) & (ratio < 1.1)), ratio


def test_both_commands_take_jittering_rows_onto_the_grid(tmp_path: Path, root: Path) -> None:
    """The yardstick of ``identify`` took them for equally spaced, and found the error of the stamps in the model."""
    arm = puma(root, 2)
    found = against_noise(arm, [_recorded(tmp_path / "run.mcap", arm, 1, 0.1)])
    assert [one.joint for one in found] == [1, 2] and all(one.ratio < 1.3 for one in found), found
