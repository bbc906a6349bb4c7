"""Joints that rest: friction holds them, so that their currents say nothing, and the model's own values stay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.simulation.simulation import simulate_at
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from identification.identify import identify_by
from identification.preprocessing.signals import smooth_motion
from identification.regression.problem import resting
from identification.result import Identification

RATE, DURATION = 487.0, 12.0  # Hz, s
POSE = np.array([0.0, -0.8, 1.9, 0.3, 0.4, 0.0])
WRIST = (3, 4, 5)


def demand(t: np.ndarray) -> np.ndarray:
    """Joints 1 to 3 move, the wrist rests."""
    t = np.asarray(t)
    ease = np.clip(t / 2, 0, 1)
    ease = ease**3 * (10 - 15 * ease + 6 * ease**2)
    q = np.tile(POSE, (len(t), 1))
    for j, (slow, quick) in enumerate([(1.1, 2.7), (0.9, 2.3), (1.3, 3.1)]):
        q[:, j] += ease * (0.5 * np.sin(slow * t) + 0.15 * np.sin(quick * t))
    return q


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


@pytest.fixture(scope="module")
def run(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """The closed loop through encoders whose counters tremble by two counts, and noisy currents."""
    random = np.random.default_rng(4)
    t = (np.arange(int(DURATION * RATE) - 2) + 0.5) / RATE
    motion = simulate_at(arm, demand, t)
    counts = np.array([4 * (joint.encoder_lines or 250) * joint.ratio / (2 * np.pi) for joint in arm.joints])
    trembling = random.integers(-1, 2, motion.qm.shape) * np.isin(range(6), WRIST)
    q = (np.floor(motion.qm * counts) + trembling) / counts
    path = tmp_path_factory.mktemp("resting") / "run.mcap"
    signals = {"q": q, "i": motion.current + 0.006 * random.standard_normal(q.shape)}
    write_table(path, motion.t, signals, Attachments())
    return open_recording(path)


@pytest.fixture(scope="module")
def start(arm: Arm) -> Arm:
    """A model that is wrong where the run can tell."""
    return replace(
        arm,
        joints=tuple(replace(joint, viscous=(0.8 * joint.viscous[0], 0.8 * joint.viscous[1])) for joint in arm.joints),
    )


@pytest.fixture(scope="module")
def result(run: Recording, start: Arm) -> Identification:
    return identify_by("wls", [run], start)


def test_resting_joints_keep_the_model_and_say_why(result: Identification, start: Arm) -> None:
    for j in WRIST:
        kept, given = result.arm.joints[j], start.joints[j]
        # Not an offset of -0.04 A, as half of the difference between the directions' Coulomb friction would be.
        np.testing.assert_allclose(kept.offset, given.offset, atol=1e-12)
        np.testing.assert_allclose(kept.coulomb, given.coulomb, rtol=1e-9)
        np.testing.assert_allclose(kept.viscous, given.viscous, rtol=1e-9)
        np.testing.assert_allclose(kept.rotor_inertia, given.rotor_inertia, rtol=1e-9)
    by_name = {value.name: value for value in result.parameters}
    for entry in ("coulomb", "offset", "viscous", "rotor_inertia"):
        value = by_name[f"joint5.{entry}"]
        assert not value.identifiable and value.std is None
        assert "rests" in value.why and "stiction" in value.why


def test_moving_joints_are_found_beside_resting_ones(result: Identification, arm: Arm) -> None:
    for j in range(3):
        found, true = result.arm.joints[j], arm.joints[j]
        np.testing.assert_allclose(found.viscous, true.viscous, rtol=0.05)
        # The model distinguishes the directions, and so do the results.
        np.testing.assert_allclose(found.coulomb, true.coulomb, rtol=0.05)
        assert found.offset == true.offset
    assert result.relative_error(False) < 0.02
    assert not (result.predictions[0].joint > 2).any()


def test_rest_is_told_from_a_small_motion(arm: Arm) -> None:
    t = np.arange(4000) / RATE
    step = 1e-4
    q = np.tile(POSE, (len(t), 1))
    q[:, 0] += 0.5 * np.sin(2 * t)
    q[:, 1] += 0.02 * np.sin(3 * t)  # small, and yet a motion of its own
    q[:, 2] += 0.002 * np.sin(4 * t)  # shaken by joint 1
    q = np.rint(q / step) * step
    q[:, 4] += step * np.random.default_rng(0).integers(-1, 2, len(t))
    motion = smooth_motion(t, q, np.ones_like(q))
    assert resting(motion, arm).tolist() == [False, False, True, True, True, True]


def test_a_sliding_joint_moves_however_far_the_others_turn(arm: Arm) -> None:
    """0.09 m beside a wrist that turns by 5 rad: metres are not compared with radians."""
    t = np.arange(4000) / RATE
    q = np.tile(POSE, (len(t), 1))
    q[:, 1] += 0.03 * np.sin(2 * t)  # shaken, beside joint 4
    q[:, 2] += 0.045 * np.sin(3 * t)
    q[:, 3] += 2.5 * np.sin(t)
    motion = smooth_motion(t, q, np.ones_like(q))
    assert not motion.moves(2)
    motion = replace(motion, revolute=np.array([True, True, False, True, True, True]))
    assert [motion.moves(j) for j in (1, 2, 3)] == [False, True, True]
