"""The coupling of the wrist, seen in motors that turn although their axes rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from arm_model import Arm
from arm_model.model_file import read_model
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis import other_instruments
from diagnosis.measurements.demands.wrist_coupling import wrist_coupling
from diagnosis.measurements.link_encoders.causes import link_side
from identification.selection import Split

STEP = 2 * np.pi / 1000 / 76.0
LINK_STEP = 2 * np.pi / 2**18


def _recorded(folder: Path, seed: int, coupling: dict[tuple[int, int], float], overshoot: float = 0.0) -> Recording:
    """Axis 4 swings, axis 5 swings later, axis 6 rests, or goes along with axis 4 where it overshoots.

    Motors follow their demands with a lag of 2 ms and what couples them.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 8.0, 0.002)
    axes = np.zeros((len(t), 6))
    axes[:, 3] = rng.uniform(0.3, 0.8) * np.sin(2 * np.pi * 0.4 * t) * (t < 5)
    axes[:, 4] = 0.5 * (1 - np.cos(2 * np.pi * 0.5 * (t - 4))) * (t > 4)
    if overshoot:
        axes[:, 5] = 1.2 * axes[:, 3] + 0.01 * rng.normal() * t
    motors = axes * (1.0 + np.array([0, 0, 0, 0, 0, overshoot])) - 0.002 * np.gradient(axes, 0.002, axis=0)
    for (axis, motor), c in sorted(coupling.items()):  # motor 5 has turned before it turns axis 6
        motors[:, axis - 1] -= c * motors[:, motor - 1]
    q = np.floor(motors / STEP + rng.uniform(size=6)) * STEP
    path = folder / f"{seed}.mcap"
    write_table(path, t, {"q": q, "i": rng.normal(0.0, 0.01, q.shape), "qref": axes}, Attachments())
    return open_recording(path)


def _sides(folder: Path, coupling: dict[tuple[int, int], float]) -> tuple[list[Recording], list[Recording]]:
    """Recordings to fit and to judge by."""
    recorded = [_recorded(folder, seed, coupling) for seed in range(3)]
    return recorded[:2], recorded[2:]


def test_the_coupling_is_told_with_its_coefficients(tmp_path: Path) -> None:
    hidden = {(5, 4): 0.03, (6, 4): -0.02, (6, 5): 0.1}
    (event,) = wrist_coupling(*_sides(tmp_path, hidden))
    assert event.effect == "wrist_coupling"
    for parameter in event.parameters:
        true = hidden[int(parameter.name[1]), int(parameter.name[2])]
        assert abs(parameter.value - true) < 2 * parameter.std
        assert parameter.std < 0.1 * abs(true) + 1e-3
    assert event.gain is not None and event.gain.unit == "rad"
    assert event.gain.after < 0.2 * event.gain.before


def test_a_servo_that_lags_turns_no_other_motor(tmp_path: Path) -> None:
    assert wrist_coupling(*_sides(tmp_path, {})) == []


def test_an_axis_that_goes_further_than_told_is_turned_by_no_other(tmp_path: Path) -> None:
    """On a KUKA KR300 motor 6 goes a tenth further than its demand while axis 4 moves in step with it.

    No coupling of the two.
    """
    fit, held_out = (_recorded(tmp_path, seed, {}, overshoot=0.1) for seed in range(2))
    assert wrist_coupling([fit], [held_out]) == []


@pytest.mark.parametrize("sways", [0.0, 0.02])
def test_a_coupling_predicts_each_part_of_a_recording_from_the_other(tmp_path: Path, sways: float) -> None:
    """Axis 6 also sways by itself in one part: what the other predicts there is less than nine tenths."""
    first, second = (_recorded(tmp_path, seed, {(6, 4): 0.05}) for seed in range(2))
    q = first.q.copy()
    q[:, 5] += sways * np.sin(2 * np.pi * 1.7 * first.t)
    found = wrist_coupling([replace(first, q=q)], [replace(second, path=first.path)])
    assert [event.effect for event in found] == ([] if sways else ["wrist_coupling"])


@pytest.mark.parametrize("only", [(5, 4), (6, 5)])
def test_one_coupling_leaves_the_others_at_zero(tmp_path: Path, only: tuple[int, int]) -> None:
    (event,) = wrist_coupling(*_sides(tmp_path, {only: 0.05}))
    estimated = {p.name: p.value for p in event.parameters}
    assert estimated[f"c{only[0]}{only[1]}"] == pytest.approx(0.05, rel=0.05)
    assert sum(abs(value) for value in estimated.values()) < 0.06


def test_link_encoders_tell_the_coupling_without_demands(root: Path, tmp_path: Path) -> None:
    hidden = {(5, 4): 0.03, (6, 4): -0.02, (6, 5): 0.1}
    coupling = np.eye(6)
    for (axis, motor), c in hidden.items():
        coupling[axis - 1, motor - 1] = c
    read = []
    for seed in range(2):
        r = _recorded(tmp_path, seed, hidden)
        ql = np.round(r.q @ coupling.T / LINK_STEP) * LINK_STEP
        path = tmp_path / f"links_{seed}.mcap"
        write_table(path, r.t, {"q": r.q, "i": r.i, "ql": ql}, Attachments())
        read.append(open_recording(path))
    found = link_side(read_model(root / "config" / "models" / "puma560.toml"), Split(read[:1], read[1:]))
    assert found is not None
    (cause,) = found.causes
    assert cause.key == ("wrist_coupling", None)
    assert "joints 5 and 6" in cause.evidence
    for parameter in cause.parameters:
        true = hidden[int(parameter.name[1]), int(parameter.name[2])]
        assert abs(parameter.value - true) < 2 * parameter.std < 0.1 * abs(true)
    assert found.unexplained == []


def test_the_tracker_sees_links_where_all_motors_turn_them(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Arm] = []
    monkeypatch.setattr(other_instruments, "tracked_causes", lambda arm, *sides, **others: seen.append(arm))
    recordings = Split(*_sides(tmp_path, {(6, 5): 0.1}))
    arm = read_model(root / "config" / "models" / "puma560.toml")
    cleaned = SimpleNamespace(samples=[(r.t, r.q, r.i) for side in recordings for r in side])
    found = other_instruments.measure(arm, recordings, cleaned, lambda sentence: None)  # type: ignore[arg-type]
    assert [event.effect for event in found.events] == ["wrist_coupling"]
    assert seen[0].coupling_matrix[5, 4] == pytest.approx(0.1, abs=0.01)
    assert arm.coupling_matrix[5, 4] == 0.0
