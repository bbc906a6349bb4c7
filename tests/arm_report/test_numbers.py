"""Estimates as text: no more digits than two standard deviations have."""

from __future__ import annotations

import math

import pytest

from arm_report.numbers import significant, value_and_two_std


@pytest.mark.parametrize(
    ("value", "std", "printed"),
    [
        (2.94051, 0.0017, ("2.9405", "0.0034")),
        (-7.9475e-05, 0.0001, ("-0.00008", "0.00020")),
        (-1e-6, 0.0007, ("0.0000", "0.0014")),
        (202.26, 8.4, ("202", "17")),
        (20.52, 0.498, ("20.5", "1.0")),
        (0.4, 0.0, ("0.4", "0")),
        (1.23456789, 1e-12, ("1.2346", "2e-12")),
        (95.0384, None, ("95.038", "")),
        (95.0384, math.nan, ("95.038", "")),
    ],
)
def test_a_value_ends_where_its_two_std_ends(value: float, std: float | None, printed: tuple[str, str]) -> None:
    assert value_and_two_std(value, std) == printed


@pytest.mark.parametrize(
    ("value", "printed"),
    [
        (0.12, "0.120"),
        (0.0932, "0.0932"),
        (1.0, "1.00"),
        (119.6, "120"),
        (16540.0, "16500"),
        (0.0, "0"),
        (-0.02104, "-0.0210"),
        (2e-7, "2.00e-07"),
    ],
)
def test_numbers_of_a_column_are_as_exact(value: float, printed: str) -> None:
    """A column of 0.12, 0.0932 and 0.022 N m looked as if each were measured otherwise."""
    assert significant(value) == printed
