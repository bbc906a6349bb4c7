"""Rows with stamps of their own: a log whose sampling jitters is judged as one whose sampling does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm_model.description import Arm
from arm_model.rigid_body.numeric import rigid_torque
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.diagnose import diagnose
from diagnosis.screening.even_rows import even, even_samples, grid_of
from tests.comparison.second_day import motion, puma


def _recorded(path: Path, arm: Arm, seed: int, jitter: float) -> Recording:
    """15 s at 250 Hz; instants off by ``jitter`` periods (standard deviation), and stamped as they were."""
    rng = np.random.default_rng(seed)
    t = (np.arange(3750) + jitter * np.clip(rng.normal(size=3750), -2, 2)) / 250.0
    q, qd, qdd = motion(t, len(arm), seed, 1.6)
    torque = rigid_torque(arm, q, qd, qdd)
    for j, joint in enumerate(arm.joints):
        # the law of the model file: coulomb (positive, negative) and viscous at the motor
        smooth = qd[:, j] / np.hypot(qd[:, j], joint.sign_velocity)
        dry = np.where(qd[:, j] > 0, joint.coulomb[0], joint.coulomb[1])
        wet = np.where(qd[:, j] > 0, joint.viscous[0], joint.viscous[1])
        torque[:, j] += joint.ratio**2 * (joint.rotor_inertia * qdd[:, j] + wet * qd[:, j]) + joint.ratio * dry * smooth
    i = torque / arm.joint_array("drive_constant") + 0.01 * rng.standard_normal(q.shape)
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


def test_even_rows_and_torn_ones_are_left_alone(tmp_path: Path, root: Path) -> None:
    recording = _recorded(tmp_path / "run.mcap", puma(root, 2), 1, 0.005)
    assert even([recording])[0] is recording
    torn = np.delete(np.arange(100) + 0.1 * np.sin(np.arange(100)), slice(40, 44))
    # stamps of a clock that was fitted: 3 us rms at 1 kHz, the worst of ten thousand 30 us
    fitted = np.arange(10000) * 1e-3 + 3e-6 * np.random.default_rng(1).standard_normal(10000)
    fitted[5000] += 3e-5
    assert grid_of(fitted) is None
    assert grid_of(torn) is None and grid_of(np.arange(2.0)) is None
