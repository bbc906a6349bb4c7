"""Currents that are read later or earlier than before, beside the angles: named as that, with the delay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from arm_model.description import Arm
from comparison.from_recordings import compare_recordings
from daq.recording import Recording
from tests.comparison.second_day import puma, record

QUICK: dict[str, Any] = {"seconds": 12.0, "rate": 250.0, "speed": 2.5}
"""Up to 1.25 Hz: 25 ms are a fifth of a radian of its fastest part, which is not of first order."""


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return puma(root, 2)


@pytest.fixture(scope="module")
def before(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return record(tmp_path_factory.mktemp("day") / "before.mcap", arm, 1, **QUICK)


@pytest.mark.parametrize("seed", [0, 1], ids=["same motion", "another motion"])
@pytest.mark.parametrize("late", [0.015, -0.025])
def test_currents_that_are_read_at_another_time_are_named(
    arm: Arm, before: Recording, tmp_path: Path, late: float, seed: int
) -> None:
    """Not as a soft gear of one joint, whose column is nearly that of a delay there."""
    after = record(tmp_path / "after.mcap", arm, 2, **QUICK, seed=seed, late=late)
    result = compare_recordings([before], [after], arm)
    one, *others = result.significant
    assert one.quantity.name == "time_skew.delay" and others == [] and result.alternatives == []
    assert one.std is not None and one.std < 0.0015 and one.change == pytest.approx(late, abs=3 * one.std)
    (summary,) = result.summaries
    assert summary.effect == "time_skew" and ("later" if late > 0 else "earlier") in summary.sentence
    assert summary.parameters["delay"][0] == one.change


def test_other_changes_are_what_they_are_beside_a_delay(arm: Arm, before: Recording, tmp_path: Path) -> None:
    """The single recordings are judged with their currents put back."""
    after = record(tmp_path / "after.mcap", arm, 2, **QUICK, late=0.02, levels=(26.0, 10.0, 6.0))
    found = {one.quantity.name: one for one in compare_recordings([before], [after], arm).significant}
    level = found.pop("joint1.coulomb")
    assert level.std is not None and level.change == pytest.approx(6.0, abs=3 * level.std)
    assert found.pop("time_skew.delay").after == pytest.approx(0.02, abs=0.002)
    assert {one.quantity.kind for one in found.values()} <= {"curve"}
