"""What only the fitted recordings show is not named, and not passed over either."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from arm_model.model_file import read_model
from diagnosis.cause import Signal, Structure
from diagnosis.diagnose import not_held_out
from diagnosis.selection.design import Dataset

ARM = read_model(Path(__file__).resolve().parents[2] / "config" / "models" / "puma560.toml")
ROWS = 1200


def _side() -> Dataset:
    one = SimpleNamespace(deviation=np.ones((ROWS, 6)), noise=np.ones(6), t=np.arange(ROWS) / 100.0)
    block = np.tile((one.t // 1.0).astype(np.intp), 6)
    return Dataset(cast(Any, (one,)), cast(Any, (one,)), np.zeros(6 * ROWS), block, ROWS)


def test_a_joint_that_only_the_fitted_recordings_find_loud_is_told() -> None:
    left = np.random.default_rng(1).normal(size=(6, ROWS))
    left[1, : ROWS // 3] += 12.0 * np.sin(np.arange(ROWS // 3) / 20.0)

    (said,) = not_held_out(left.ravel(), _side(), [], ARM)

    assert "joint 2" in said and "hold out" in said
    assert not_held_out(left.ravel(), _side(), [Structure(Signal.CURRENT, 2, "position", 0.5)], ARM) == ()
    assert not_held_out(np.random.default_rng(2).normal(size=6 * ROWS), _side(), [], ARM) == ()
