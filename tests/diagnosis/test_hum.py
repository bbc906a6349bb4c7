"""Hum that several currents share is one cause of the rig; hum of one current is a cause of that joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io.types import Array
from arm_model import Arm, write_model
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.cause import extend
from diagnosis.measurements.currents.causes import from_event
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.report.wording import title
from diagnosis.report.write import _cause
from diagnosis.residual.generation import residual_run
from diagnosis.screening.event import Event
from diagnosis.screening.mains_hum import lines_near_mains, mains_hum, other_lines, without_hum
from identification.selection import Split

RATE, JOINTS = 500.0, 6


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return armscope.read_model(root / "config/models/puma560.toml")


def _recorded(path: Path, amplitudes: dict[int, float], seed: int) -> Recording:
    """A line at 49.96 Hz of these amplitudes (A) by joint, each with its own phase."""
    rng = np.random.default_rng(seed)
    phases = {joint: rng.uniform(0, 6) for joint in amplitudes}
    return _with_lines(
        path,
        seed,
        lambda t, joint: amplitudes.get(joint, 0.0) * np.sin(2 * np.pi * 49.96 * t + phases.get(joint, 0.0)),
    )


def _with_lines(
    path: Path, seed: int, lines: Callable[[Array, int], Array], *, rate: float = RATE, noise: float = 5e-3
) -> Recording:
    """Slow sines, noise (A), and ``lines`` of t (m,) s and joint."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 10.0, 1 / rate)
    motion = np.sin(np.outer(t, rng.uniform(0.5, 1.5, JOINTS)))
    i = motion + rng.normal(0.0, noise, motion.shape)
    i += np.column_stack([lines(t, joint) for joint in range(1, JOINTS + 1)])
    write_table(path, t, {"q": motion, "i": i}, Attachments())
    return open_recording(path)


def test_hum_of_all_currents_is_one_event_of_the_rig(arm: Arm, tmp_path: Path) -> None:
    amplitudes = {joint: 0.01 * joint for joint in range(1, JOINTS + 1)}
    recordings = [_recorded(tmp_path / f"{n}.mcap", amplitudes, n) for n in range(2)]
    (event,) = _hum(recordings, arm)
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
        assert _hum([recording], arm)
        t = recording.t
        for column in clean.T:
            line = abs(np.sum((column - column.mean()) * np.hanning(len(t)) * np.exp(-2j * np.pi * 49.96 * t)))
            assert line / np.sum(np.hanning(len(t))) < 0.2e-3


@pytest.mark.parametrize("joints", [(2,), (2, 5), (1, 2, 3)])
def test_hum_of_few_currents_is_of_their_joints(arm: Arm, tmp_path: Path, joints: tuple[int, ...]) -> None:
    events = _hum([_recorded(tmp_path / "a.mcap", dict.fromkeys(joints, 0.03), 1)], arm)
    assert [event.joint for event in events] == list(joints)
    assert not any(event.of_joints for event in events)


def _hum(recordings: list[Recording], arm: Arm) -> list[Event]:
    return mains_hum(recordings, lines_near_mains(recordings, arm), arm)


def _told(arm: Arm, recording: Recording) -> tuple[list[int | None], list[str]]:
    """Joints of hum, and what is said of other lines."""
    lines = lines_near_mains([recording], arm)
    return [event.joint for event in mains_hum([recording], lines, arm)], list(other_lines(lines, arm))


@pytest.mark.parametrize("frequency", [49.48, 49.1, 60.7])
def test_a_steady_line_beside_the_mains_is_told_as_what_it_is(arm: Arm, tmp_path: Path, frequency: float) -> None:
    def line(t: Array, joint: int) -> Array:
        return 0.03 * (joint == 2) * np.sin(2 * np.pi * frequency * t)

    hum, (said,) = _told(arm, _with_lines(tmp_path / "a.mcap", 1, line))
    assert hum == [] and said.startswith(f"unexplained: a line of the current, {frequency:.2f} Hz at joint 2 (0.03 A)")


def test_a_line_that_comes_and_goes_with_the_motion_is_no_mains(arm: Arm, tmp_path: Path) -> None:
    """Setpoints every 20 ms: transients follow the acceleration, so that nothing is at 50 Hz itself."""

    def line(t: Array, joint: int) -> Array:
        return 0.05 * (joint == 3) * np.sin(1.3 * t) * np.sin(2 * np.pi * 50.0 * t)

    recording = _with_lines(tmp_path / "a.mcap", 1, line)
    unknown = replace(arm, controller=None)
    hum, (said,) = _told(unknown, recording)
    assert hum == [] and "at joint 3" in said and "its amplitude varies" in said
    assert arm.controller is not None
    known = replace(arm, controller=replace(arm.controller, setpoint_period=0.02))
    assert _told(known, recording) == ([], [])


def test_one_line_of_many_is_no_mains(arm: Arm, tmp_path: Path) -> None:
    """Pulses twice a second, as of the second recording of EMPS: lines every 2 Hz."""

    def pulses(t: Array, joint: int) -> Array:
        return np.asarray(0.5 * (joint == 1) * (np.mod(t, 0.5) < 0.002), float)

    assert _told(arm, _with_lines(tmp_path / "a.mcap", 1, pulses)) == ([], [])


def test_a_line_of_setpoints_beyond_the_sampling_rate_is_no_mains_but_hum_there_is(arm: Arm, tmp_path: Path) -> None:
    """Setpoints every 24 ms at 983 rows/s: their 46th line is at 1916.7 Hz, and seen at 49.3 Hz."""
    assert arm.controller is not None
    known = replace(arm, controller=replace(arm.controller, setpoint_period=0.024))

    def faint(t: Array, joint: int) -> Array:
        return 2.5e-3 * (joint == 1) * np.sin(1.3 * t) * np.sin(2 * np.pi * 46 / 0.024 * t)

    def hum(t: Array, joint: int) -> Array:
        return 0.02 * (joint == 1) * np.sin(2 * np.pi * 49.9 * t)

    ripple = _with_lines(tmp_path / "a.mcap", 1, faint, rate=983.0)
    assert _told(known, ripple) == ([], []) and any(_told(replace(known, controller=None), ripple))
    assert _told(known, _with_lines(tmp_path / "b.mcap", 1, hum, rate=983.0)) == ([1], [])


def test_a_cause_of_the_rig_is_told_once_and_modelled_at_every_joint(arm: Arm, tmp_path: Path) -> None:
    recording = _recorded(tmp_path / "a.mcap", dict.fromkeys(range(1, JOINTS + 1), 0.05), 1)
    (event,) = _hum([recording], arm)
    data = dataset_of([residual_run("a", arm, recording.t, recording.q, recording.i)])
    hum = from_event(event, arm, Split(data, data))
    assert title(hum) == "mains hum"
    row = _cause(hum)
    assert row["joint"] is None
    assert [one["joint"] for one in row["joints"]] == list(range(1, JOINTS + 1))
    write_model(tmp_path / "model.toml", extend(arm, [hum]))
    again = armscope.read_model(tmp_path / "model.toml")
    assert [(term.name, term.joint) for term in again.effects] == [("mains_hum", j) for j in range(1, JOINTS + 1)]


@pytest.mark.parametrize("hum", [0.0, 0.03])
def test_hum_beside_setpoints_at_its_frequency_shows_while_the_arm_stands(arm: Arm, tmp_path: Path, hum: float) -> None:
    """Setpoints every 20 ms: their transients follow the acceleration, and what is left while nothing moves is hum."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 12.0, 1 / RATE)
    moving = np.clip(t - 1.0, 0.0, None)
    q = 0.5 * (1.0 - np.cos(np.outer(moving, rng.uniform(0.5, 1.5, JOINTS))))
    push = np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    i = q + 0.05 * push * np.sin(2 * np.pi * 50.0 * t)[:, None] + rng.normal(0.0, 5e-3, q.shape)
    i[:, 1] += hum * np.sin(2 * np.pi * 50.004 * t + 1.0)
    write_table(tmp_path / "a.mcap", t, {"q": np.round(q / 1e-5) * 1e-5, "i": i}, Attachments())
    assert arm.controller is not None
    known = replace(arm, controller=replace(arm.controller, setpoint_period=0.02))
    recording = open_recording(tmp_path / "a.mcap")
    found = _hum([recording], known)
    assert [event.joint for event in found] == ([2] if hum else [])
    for event in found:
        amplitude = next(p for p in event.parameters if p.name == "amplitude")
        assert amplitude.value == pytest.approx(hum, rel=0.3)


@pytest.mark.parametrize("hum", [0.0, 0.03])
def test_hum_where_a_line_of_setpoints_folds_shows_wherever_the_arm_stands(
    arm: Arm, tmp_path: Path, hum: float
) -> None:
    """Setpoints every 4 ms at 800 rows/s: their third line is seen at 50 Hz. The second recording never stands."""
    rng, rate, recordings = np.random.default_rng(4), 800.0, []
    for begins in (1.0, 0.0):
        t = np.arange(0.0, 12.0, 1 / rate)
        moving = np.clip(t - begins, 0.0, None)
        q = 0.5 * (1.0 - np.cos(np.outer(moving, rng.uniform(0.5, 1.5, JOINTS)))) + 0.1 * (begins == 0.0) * t[:, None]
        push = np.gradient(np.gradient(q, t, axis=0), t, axis=0)
        i = q + 0.05 * push * np.sin(2 * np.pi * 750.0 * t)[:, None] + rng.normal(0.0, 5e-3, q.shape)
        i[:, 1] = q[:, 1] + hum * np.sin(2 * np.pi * 49.98 * t + 1.0) + rng.normal(0.0, 5e-3, len(t))
        write_table(tmp_path / f"{begins}.mcap", t, {"q": np.round(q / 1e-5) * 1e-5, "i": i}, Attachments())
        recordings.append(open_recording(tmp_path / f"{begins}.mcap"))
    assert arm.controller is not None
    known = replace(arm, controller=replace(arm.controller, setpoint_period=0.004))
    assert [event.joint for event in _hum(recordings, known)] == ([2] if hum else [])
