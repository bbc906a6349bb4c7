"""Friction is compared at the speeds that two recordings of each side reach; one that creeps takes none from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_model.description import Arm
from comparison.friction_curves import common_curves, knots_of
from comparison.from_recordings import compare_recordings
from daq.recording import Recording
from identification.regression.problem import motions_of
from tests.comparison.second_day import puma, record

SHORT: dict[str, Any] = {"seconds": 12.0, "rate": 125.0}
CREEP = 0.03
"""Of the speed of the others."""
WORN = (24.0, 10.0)


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return puma(root, 2)


@pytest.fixture(scope="module")
def days(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> list[list[Recording]]:
    """Three recordings before and after, the last of each creeps; friction of joint 1 is 4 N m larger after."""
    folder = tmp_path_factory.mktemp("days")
    return [
        [
            record(folder / f"{day}{k}.mcap", arm, 10 * day + k, **SHORT, seed=k, levels=levels, speed=speed)
            for k, speed in enumerate((1.0, 1.2, CREEP))
        ]
        for day, levels in enumerate(((20.0, 10.0), WORN))
    ]


def test_speeds_are_those_that_two_of_each_side_reach(arm: Arm, days: list[list[Recording]]) -> None:
    recordings = [*days[0], *days[1]]
    motions, _, _ = motions_of(recordings, [], arm, lambda _: None)
    is_before = np.array([True] * 3 + [False] * 3)
    curve = common_curves(motions, [one.path.name for one in recordings], arm, is_before)[0]
    assert len(curve.speeds) > 2
    for motion, creeps in zip(motions, [False, False, True] * 2):
        knots, place = knots_of(curve, motion)
        assert len(knots) == len(place)
        assert (place < 0).all() == creeps


def test_friction_that_grew_is_named_beside_recordings_that_creep(arm: Arm, days: list[list[Recording]]) -> None:
    found = {one.quantity.name: one for one in compare_recordings(*days, arm).significant}
    level = found["joint1.coulomb"]
    assert level.std is not None and level.change == pytest.approx(4.0, abs=3 * level.std)
    assert {one.quantity.joint for one in found.values()} == {1}
