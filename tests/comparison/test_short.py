"""A recording that is too short to judge alone is said to be, with what it lacks; the others are compared."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_io import InputError
from arm_model import Arm
from comparison.from_recordings import compare_recordings
from daq.recording import Recording
from tests.comparison.second_day import LEVELS, puma, record

LONG: dict[str, Any] = {"seconds": 14.0, "rate": 125.0}
SHORT: dict[str, Any] = {"seconds": 1.5, "rate": 125.0, "seed": 3}
"""35 rows for 19 values."""
MORE = LEVELS[0] * 1.5, LEVELS[1]


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return puma(root, 2)


@pytest.fixture(scope="module")
def before(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return record(tmp_path_factory.mktemp("day") / "before.mcap", arm, 1, **LONG)


def test_a_side_without_another_recording_cannot_be_judged(arm: Arm, before: Recording, tmp_path: Path) -> None:
    result = compare_recordings([before], [record(tmp_path / "after.mcap", arm, 2, levels=MORE, **SHORT)], arm)
    assert not result.significant and not result.tested
    lacking = "after.mcap is too short to judge alone: at least 1 s more of such motion are needed (it has 1.5 s"
    assert {one.quantity.why.startswith(lacking) for one in result.changes} == {True}
    assert str(result).splitlines()[-1].startswith(f"Nothing could be compared: {lacking}")
    json.dumps(result.to_json(), allow_nan=False)


@pytest.mark.parametrize("levels, named", [(LEVELS, set()), (MORE, {"joint1.coulomb"})])
def test_beside_others_it_counts_in_the_fit_of_all(
    arm: Arm, before: Recording, tmp_path: Path, levels: Any, named: set[str]
) -> None:
    days = [("long", 2, LONG), ("short", 3, SHORT)]
    after = [record(tmp_path / f"{name}.mcap", arm, noise, levels=levels, **how) for name, noise, how in days]
    result = compare_recordings([before], after, arm)
    assert {one.quantity.name for one in result.significant if one.quantity.kind == "friction"} == named
    assert bool(result.significant) == bool(named) and result.tested > 12
    (warning,) = (one for one in result.warnings if "too short" in one)
    assert warning.startswith("short.mcap is too short to judge alone: ")
    assert warning.endswith("; its rows count in the fit of all recordings only")


def test_a_recording_that_leaves_no_row_is_refused(arm: Arm, before: Recording, tmp_path: Path) -> None:
    """Half of its rows have no angles, here and there: no stretch is as long as a filter."""
    after = record(tmp_path / "after.mcap", arm, 2, seconds=4.0, rate=50.0)
    q = after.q.copy()
    q[np.random.default_rng(0).random(len(q)) < 0.5] = np.nan
    with pytest.raises(InputError, match=r"after\.mcap: leaves no usable row"):
        compare_recordings([before], [replace(after, q=q)], arm)
