"""Counts that an encoder missed are reported in counts, whether its angle comes in steps or is drowned in noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_model.model_file import read_model
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.screening.encoder_jumps import jumps, without_jumps

ARM = read_model(Path(__file__).resolve().parents[2] / "config" / "models" / "puma560.toml")
COUNT = 2 * np.pi / (4 * (ARM.joints[0].encoder_lines or 0) * abs(ARM.joints[0].ratio))


def _recorded(path: Path, *, counts: float, noise: float) -> Recording:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 8.0, 1e-3)
    true = 0.4 * np.sin(0.9 * t)
    q = np.round((true + np.where(t >= 3.0, counts * COUNT, 0.0)) / COUNT) * COUNT + rng.normal(0.0, noise, len(t))
    write_table(path, t, {"q": q[:, None], "i": np.cos(0.9 * t)[:, None]}, Attachments())
    return open_recording(path)


@pytest.mark.parametrize(("counts", "noise"), [(13.0, 0.0), (13.0, 0.3 * COUNT), (-4.0, 0.0)])
def test_a_jump_is_told_in_counts(tmp_path: Path, counts: float, noise: float) -> None:
    (event,) = jumps([_recorded(tmp_path / "a.mcap", counts=counts, noise=noise)], ARM)
    found = {p.name: p for p in event.parameters}
    assert abs(found["counts"].value - counts) <= 2 * found["counts"].std
    assert abs(found["time"].value - 3.0) < 0.005


@pytest.mark.parametrize("noise", [0.0, 0.3 * COUNT])
def test_an_angle_without_a_jump_has_none(tmp_path: Path, noise: float) -> None:
    assert jumps([_recorded(tmp_path / "a.mcap", counts=0.0, noise=noise)], ARM) == []


def test_missing_rows_of_the_counters_are_no_missed_counts(tmp_path: Path) -> None:
    """Three rows missing: every joint that moves jumps as far as it turns in three.

    Put back, the angles run on as they did.
    """
    t, missing = np.arange(0.0, 8.0, 1e-3), 3
    seen = np.where(t >= 5.0, t + missing * 1e-3, t)
    q = np.column_stack([np.sin(0.9 * seen), 0.8 * np.cos(0.7 * seen), 0.3 * np.sin(seen), *np.zeros((3, len(t)))])
    q = np.round(q / COUNT) * COUNT
    write_table(tmp_path / "run.mcap", t, {"q": q, "i": np.cos(q)}, Attachments())
    recording = open_recording(tmp_path / "run.mcap")

    events = jumps([recording], ARM)

    assert [(event.effect, event.joint) for event in events] == [("dropped_trigger", None)]
    assert {p.name: p.value for p in events[0].parameters} == pytest.approx(
        {"row": 5000, "count": -missing, "period": 1e-3}
    )
    put_right = without_jumps(recording, 0, events)
    assert np.max(np.abs(put_right[:, 0] - np.sin(0.9 * t))) < 2 * COUNT
