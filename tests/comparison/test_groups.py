"""Groups of recordings of different motions: the fewest changes that explain how they differ.

Each motion alone says too little of every value at once; together, and if only one of them changed, they say it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from arm_model.description import Arm
from comparison.from_recordings import compare_recordings
from comparison.outcome import Comparison
from daq.recording import Recording
from tests.comparison.second_day import LEVELS, puma, record

DAYS: Mapping[str, Mapping[str, object]] = {
    "nothing": {},
    "friction": {"levels": (LEVELS[0], LEVELS[1], 1.1 * LEVELS[2])},
}
"""Friction of joint 3 by 0.6 N m larger."""


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return puma(root)


def day(folder: Path, arm: Arm, first: int, **what: object) -> list[Recording]:
    """Three short motions; in the third, joint 1 stands still."""
    found = []
    for k in range(3):
        path, still = folder / f"{first + k}.mcap", 0 if k == 2 else None
        more: dict[str, Any] = {"seconds": 9.0, "rate": 125.0, "resting": still, **what}
        found.append(record(path, arm, first + k, seed=first + k, **more))
    return found


@pytest.fixture(scope="module")
def before(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    return day(tmp_path_factory.mktemp("before"), arm, 10)


@pytest.fixture(scope="module", params=DAYS)
def compared(
    request: pytest.FixtureRequest, arm: Arm, before: list[Recording], tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Comparison]:
    after = day(tmp_path_factory.mktemp("after"), arm, 20, **DAYS[request.param])
    return request.param, compare_recordings(before, after, arm)


def test_a_change_that_no_motion_alone_shows(compared: tuple[str, Comparison]) -> None:
    name, result = compared
    if name == "nothing":
        assert result.significant == []
        return
    surest = max(result.significant, key=lambda one: abs(one.z or 0.0))
    assert surest.quantity.name == "joint3.coulomb"
    assert surest.std is not None and surest.change == pytest.approx(0.1 * LEVELS[2], abs=3 * surest.std)


def test_friction_is_compared_where_enough_recordings_show_it(compared: tuple[str, Comparison]) -> None:
    of_first = [one for one in compared[1].changes if one.quantity.joint == 1 and one.quantity.kind == "curve"]
    assert len(of_first) >= 6 and all(one.comparable for one in of_first)
