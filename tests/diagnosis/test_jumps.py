"""Counts that an encoder missed are told in counts, whether its angle comes in steps or is drowned in noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm_model.model_file import read_model
from daq.recording import Recording, open_recording
from daq.recording_file import Attachments
from daq.table import write_table
from diagnosis.events import jumps

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
