"""Hum that several currents share is one cause of the rig; hum of one current is a cause of that joint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm, write_model
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.cause import extend
from diagnosis.measurements.currents.causes import from_event
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.report.wording import title
from diagnosis.report.write import _cause
from diagnosis.residual.run import residual_run
from diagnosis.screening.mains_hum import mains_hum, without_hum
from identification.selection import Split

RATE, JOINTS = 500.0, 6


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return armscope.read_model(root / "config/models/puma560.toml")


def _recorded(path: Path, amplitudes: dict[int, float], seed: int) -> Recording:
    """Slow sines, noise of 5 mA, and a line at 49.96 Hz of these amplitudes (A) by joint, each with its own phase."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 10.0, 1 / RATE)
    motion = np.sin(np.outer(t, rng.uniform(0.5, 1.5, JOINTS)))
    i = motion + rng.normal(0.0, 5e-3, motion.shape)
    for joint, amplitude in amplitudes.items():
        i[:, joint - 1] += amplitude * np.sin(2 * np.pi * 49.96 * t + rng.uniform(0, 6))
    write_table(path, t, {"q": motion, "i": i}, Attachments())
    return open_recording(path)


def test_hum_of_all_currents_is_one_event_of_the_rig(arm: Arm, tmp_path: Path) -> None:
    amplitudes = {joint: 0.01 * joint for joint in range(1, JOINTS + 1)}
    recordings = [_recorded(tmp_path / f"{n}.mcap", amplitudes, n) for n in range(2)]
    (event,) = mains_hum(recordings, arm)
    assert event.joint is None
    assert sorted(event.of_joints) == list(amplitudes)
    for joint, parameters in event.of_joints.items():
        own = {p.name: p for p in parameters}
        assert abs(own["amplitude"].value - amplitudes[joint]) < 2 * own["amplitude"].std + 1e-3
        assert abs(own["frequency"].value - 49.96) < 0.005
    assert event.gain is not None
    assert event.gain.joint == JOINTS  # the largest
    # and it is taken out of all of them
    for recording in recordings:
        clean = without_hum(recording, [event])
        assert mains_hum([recording], arm)
        t = recording.t
        for column in clean.T:
            line = abs(np.sum((column - column.mean()) * np.hanning(len(t)) * np.exp(-2j * np.pi * 49.96 * t)))
            assert line / np.sum(np.hanning(len(t))) < 0.2e-3


@pytest.mark.parametrize("joints", [(2,), (2, 5), (1, 2, 3)])
def test_hum_of_few_currents_is_of_their_joints(arm: Arm, tmp_path: Path, joints: tuple[int, ...]) -> None:
    events = mains_hum([_recorded(tmp_path / "a.mcap", dict.fromkeys(joints, 0.03), 1)], arm)
    assert [event.joint for event in events] == list(joints)
    assert not any(event.of_joints for event in events)


def test_a_cause_of_the_rig_is_told_once_and_modelled_at_every_joint(arm: Arm, tmp_path: Path) -> None:
    recording = _recorded(tmp_path / "a.mcap", dict.fromkeys(range(1, JOINTS + 1), 0.05), 1)
    (event,) = mains_hum([recording], arm)
    data = dataset_of([residual_run("a", arm, recording.t, recording.q, recording.i)])
    hum = from_event(event, arm, Split(data, data))
    assert title(hum) == "mains hum"
    row = _cause(hum)
    assert row["joint"] is None
    assert [one["joint"] for one in row["joints"]] == list(range(1, JOINTS + 1))
    write_model(tmp_path / "model.toml", extend(arm, [hum]))
    again = armscope.read_model(tmp_path / "model.toml")
    assert [(term.name, term.joint) for term in again.effects] == [("mains_hum", j) for j in range(1, JOINTS + 1)]
