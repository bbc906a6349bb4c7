"""Effects in the model of the arm that moves reach the recording where an instrument would show them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.description import EffectTerm
from arm_model.model_file import read_model, write_model
from daq.acquisition.rows import Rows
from daq.rig.rig_file import read_rig
from tests.sim_backend.test_chain import _experiment, _fast, _record

EVERY_COUNT = 2 * np.pi / (4 * 200 * 107.815)  # rad of joint 2


def _run(root: Path, tmp_path: Path, *effects: EffectTerm, **changes: object) -> Rows:
    """A recording of an arm with effects on a rig that knows of none; ``changes`` are to the experiment."""
    write_model(tmp_path / "hidden.toml", replace(read_model(root / "config/models/puma560.toml"), effects=effects))
    rows, acquisition = _record(_fast(root, model=str(tmp_path / "hidden.toml")), _experiment(**changes))
    assert acquisition.ledger.summary().lost == 0
    return rows


def test_current_offset_shows_with_the_drives_off(root: Path, tmp_path: Path) -> None:
    still = {"segment": [{"type": "hold", "duration": 0.5}], "setup": {"drives_off": True}}
    rows = _run(root, tmp_path, EffectTerm("current_offset", 3, {"offset": 0.07}), **still)
    assert rows.i.mean(axis=0) == pytest.approx([0, 0, 0.07, 0, 0, 0], abs=1.5e-3)


def test_missed_counts_are_a_step_in_the_counts_of_one_joint(root: Path, tmp_path: Path) -> None:
    lost = EffectTerm("missed_counts", 2, {"counts": 25.0, "time": 1.0, "resolution": EVERY_COUNT})
    rows, whole = _run(root, tmp_path, lost), _run(root, tmp_path)
    gained = rows.counts - whole.counts
    moved = np.flatnonzero(np.ptp(gained, axis=0) > 1)
    assert moved.tolist() == [1]
    assert np.abs(gained[:990, 1]).max() <= 1 and np.abs(gained[1010:, 1] - 25).max() <= 1


def test_late_currents_are_late_and_nothing_else_is(root: Path, tmp_path: Path) -> None:
    rows, whole = _run(root, tmp_path, EffectTerm("time_skew", None, {"delay": 0.004})), _run(root, tmp_path)
    assert (rows.counts == whole.counts).all()
    error = rows.i[4:] - whole.i[:-4]
    assert np.abs(error[:, :3]).max() < 0.06 and np.abs(rows.i - whole.i).max() > 1.0


def test_backlash_lets_the_link_fall_behind_the_motor(root: Path, tmp_path: Path) -> None:
    """Motor encoder and tracker part by the gap; they agree without it."""
    to_and_fro = [{"type": "drive", "joint": 1, "to": angle, "speed": 0.3} for angle in (0.3, 0.0)]
    experiment = {"segment": to_and_fro, "start": [0.0] * 6}
    loose = _run(root, tmp_path, EffectTerm("backlash", 1, {"half_gap": 2e-3}), **experiment)
    tight = _run(root, tmp_path, **experiment)
    tracker = np.array(read_rig(root / "config/puma560_sim.toml", drivers=False).tracker.base_from_tracker)

    def lead(rows: Rows) -> np.ndarray:
        """rad by which motor 1 is ahead of the target's bearing, at the rows with a point."""
        assert rows.points is not None
        seen = ~np.isnan(rows.points[:, 0])
        target = rows.points[seen] @ tracker[:3, :3].T + tracker[:3, 3]
        ahead = rows.q[seen, 0] - np.arctan2(target[:, 1], target[:, 0])
        return ahead - ahead[0]

    assert np.ptp(lead(loose)) == pytest.approx(4e-3, rel=0.25)
    assert np.ptp(lead(tight)) < 1.5e-3


def test_an_effect_that_counts_rows_is_pointed_to_the_rig(root: Path, tmp_path: Path) -> None:
    dropped = EffectTerm("dropped_trigger", None, {"row": 100.0, "count": 1.0, "period": 1e-3})
    with pytest.raises(InputError, match="lost_edge"):
        _run(root, tmp_path, dropped)
