"""Current limits of one side alone, and friction that grows with the load: what each is compared with."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm_model.model_file import read_model
from comparison import current_limits
from comparison.current_limits import limit_changes
from comparison.load_friction import load_columns, mean_loads
from diagnosis.cause import Estimate
from identification.preprocessing.signals import smooth_motion


@pytest.mark.parametrize(("largest", "comparable"), [(5.0, False), (10.0, False), (20.0, True)])
@pytest.mark.parametrize("limited", ["before", "after"])
def test_a_limit_of_one_side_is_a_change_if_the_other_goes_beyond_it(
    root: Path, monkeypatch: pytest.MonkeyPatch, limited: str, largest: float, comparable: bool
) -> None:
    """A limit of 10 A: of a side that only needs 5 A nobody knows what its drive gives."""
    t = np.arange(0.0, 10.0, 0.002)
    recordings: dict[str, Any] = {
        side: SimpleNamespace(dt=0.002, i=np.full((len(t), 2), 10.0 if side == limited else largest))
        for side in ("before", "after")
    }
    event = SimpleNamespace(joint=1, parameters=[Estimate("limit", 10.0, 0.01, "A")])
    monkeypatch.setattr(
        current_limits, "current_limits", lambda side, arm: [event] if side[0] is recordings[limited] else []
    )
    arm = read_model(root / "config/models/two_link.toml")
    (change,) = limit_changes([recordings["before"]], [recordings["after"]], arm)
    assert change.comparable is comparable and change.significant is comparable


def test_friction_of_the_mean_load_belongs_to_the_curve(root: Path) -> None:
    """Along its own direction, the column of load friction has the mean 0: it is what varies about the mean."""
    t = np.arange(0.0, 8.0, 0.004)
    q = 0.6 * np.column_stack([np.sin(1.3 * t), np.sin(2.1 * t + 1.0)])
    arm, motion = read_model(root / "config/models/two_link.toml"), smooth_motion(t, q, np.zeros_like(q))
    means = mean_loads(arm, [motion])
    along = load_columns(arm, motion, means) * np.sign(motion.qd)
    assert np.isfinite(means).all()
    np.testing.assert_allclose(along.mean(axis=0), 0.0, atol=1e-9 * means.max())
    assert np.all(along.std(axis=0) > 0.05 * means)
