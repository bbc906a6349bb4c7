"""Friction steps where a joint reverses, and the low-pass of a recording rings there: both sides of the equations do.

The low-pass follows the motion: of a slightly faster one it is wider, and the rows of the joint fit are closer.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comparison.from_recordings import compare_recordings
from comparison.regression import Rows, rows_of, structure_of
from identification.preprocessing import signals
from identification.preprocessing.signals import Motion, smooth_motion
from identification.preprocessing.spectrum import Band, choose_band
from identification.regression.base_parameters import structural_base
from identification.ripples import wide
from tests.comparison.second_day import motion, puma, record

LEVEL, RATE = 20.0, 250.0


def reversing(speed: float) -> Motion:
    """Two joints with friction alone, of LEVEL and 1 N m s/rad, without noise."""
    t = np.arange(int(12.0 * RATE)) / RATE
    q, qd, _ = motion(t, 2, 0, speed)
    band = choose_band(q, 1.0 / RATE)
    return smooth_motion(t, q, LEVEL * np.sign(qd) + qd, band=band)


def left(rows: Rows) -> np.ndarray:
    """What friction curves leave of the rows' torques."""
    columns = np.concatenate([rows.columns, rows.own], axis=1)
    return np.asarray(rows.y - columns @ np.linalg.lstsq(columns, rows.y, rcond=None)[0])


@pytest.mark.parametrize("speed", [2.0, 2.5])
def test_friction_that_steps_leaves_nothing_in_the_rows_of_the_joint_fit(root: Path, speed: float) -> None:
    """A row or two of each reversal, in which the low-pass rings by some per cent of the step."""
    arm, whole = puma(root, 2), reversing(speed)
    structure = structure_of(arm, structural_base(arm, "asymmetric"), [whole] * 2, ["", ""], np.array([True, False]))
    rows = rows_of(structure, wide(whole), arm, whole)
    assert np.abs(left(rows)).max() < 0.003 * LEVEL


@pytest.mark.parametrize("wider", [0, 1], ids=["before", "after"])
def test_nothing_is_named_where_one_low_pass_is_a_little_wider(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wider: int
) -> None:
    """Of the same motion: the rows of one side stand elsewhere at each reversal, and that looked like a delay."""
    arm, known = puma(root, 2), iter((1.06, 1.0) if wider == 0 else (1.0, 1.06))

    def chosen(q: np.ndarray, dt: float) -> Band:
        motion = next(known) * 11.65
        return replace(choose_band(q, dt), motion=motion, parallel=motion / 2)

    monkeypatch.setattr(signals, "choose_band", chosen)
    pair = [record(tmp_path / f"{k}.mcap", arm, k + 1, speed=2.5) for k in (0, 1)]
    assert compare_recordings(pair[:1], pair[1:], arm).significant == []


@pytest.mark.parametrize("turn", [0.0, 0.01], ids=["step", "smooth"])
def test_a_large_change_of_slow_friction_is_a_change_of_its_level_alone(
    root: Path, tmp_path: Path, turn: float
) -> None:
    """However friction turns at a reversal: below its ``sign_velocity`` a smooth one is not at its level."""
    arm = puma(root, 2)
    slow: dict[str, Any] = {"seconds": 60.0, "speed": 0.2, "turn": turn}
    before = record(tmp_path / "before.mcap", arm, 1, **slow)
    after = record(tmp_path / "after.mcap", arm, 2, levels=[28.0, 10.0], **slow)
    found = {one.quantity.name: one for one in compare_recordings([before], [after], arm).significant}
    level = found.pop("joint1.coulomb")
    assert level.std is not None and level.change == pytest.approx(8.0, abs=2 * level.std) and level.std < 0.2
    assert {one.quantity.kind for one in found.values()} <= {"curve"}
