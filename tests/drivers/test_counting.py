"""A counter at 0: one that lost its power, or one whose joint came to rest there."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from drivers.counting import ZeroAfterMotion

ROW = 10_000_000  # ns


def found_at(counts: Iterable[int]) -> int | None:
    """The row in which the power is noticed to have gone."""
    history = ZeroAfterMotion()
    return next((row for row, count in enumerate(counts) if history.lost_power(count, 10**12 + row * ROW)), None)


def test_a_fall_from_afar_is_noticed_in_its_row() -> None:
    assert found_at([20_000, 19_990, 0, 0]) == 2


@pytest.mark.parametrize("last", [30, -30, 1, 64])
def test_a_counter_that_was_turning_near_0_is_noticed_one_row_later(last: int) -> None:
    assert found_at([last - 628, last - 314, last, 0, 0, 0]) == 4


@pytest.mark.parametrize("count", [0, 7])
def test_a_joint_that_stands_or_comes_to_rest_at_0_has_its_power(count: int) -> None:
    assert found_at([count] * 5) is None
    assert found_at([400, 250, 140, 80, 30, 8, 0, 0, 0]) is None  # 64 counts per row fewer each row: at most that


def test_a_joint_that_turns_through_0_has_its_power() -> None:
    assert found_at([-50, 0, 50, 100]) is None
    assert found_at([0, 314, 628]) is None


def test_a_new_row_at_0_after_a_long_gap_is_no_stop() -> None:
    history = ZeroAfterMotion()
    rows = [(-328, 0), (-14, ROW), (0, 40 * ROW), (0, 41 * ROW)]  # it had 0.4 s to come to rest
    assert not any(history.lost_power(count, 10**12 + at) for count, at in rows)
