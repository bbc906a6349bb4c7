"""Recordings little longer than the shortest that is not refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm
from diagnosis.screening.cleaned import residuals_of, screened


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return armscope.read_model(root / "config/starters/csv/model.toml")


@pytest.mark.parametrize("seconds", np.arange(2.6, 5.0, 0.2))
def test_dropped_triggers_are_looked_for_in_a_run_of_any_length(
    arm: Arm, root: Path, tmp_path: Path, seconds: float
) -> None:
    motion = armscope.read_experiment(root / "config/starters/csv/fit.toml")
    pause, series = motion.segment[:2]
    short = motion.model_copy(update={"segment": [pause, series.model_copy(update={"duration": seconds, "fade": 0.4})]})
    recording = armscope.simulate(arm, short).write(tmp_path / "short.mcap")
    assert len(residuals_of(arm, screened(arm, [recording])).runs) == 1
