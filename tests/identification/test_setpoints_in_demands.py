"""The period of setpoints from recorded demands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from identification.preprocessing.setpoints_in_demands import setpoint_period


def _plan(t: np.ndarray) -> np.ndarray:
    """(m, 2) rad: a joint that stands for a second and then waves, and one that moves twice."""
    return np.column_stack([np.sin(2 * np.pi * 0.4 * np.maximum(t - 1, 0)), np.cos(np.clip(t - 3, 0, np.pi))])


@settings(max_examples=25)
@given(
    rate=st.sampled_from([250.0, 333.0, 500.0, 983.0, 1000.0, 2000.0]),
    period=st.sampled_from([0.004, 0.008, 0.01, 0.02, 0.024, 0.028]),
    phase=st.floats(0.0, 1.0),
)
def test_the_period_of_straight_lines(rate: float, period: float, phase: float) -> None:
    t = np.arange(0.0, 8.0, 1 / rate)
    knots = np.arange(-1.0, 10.0, period) + phase * period
    demands = np.column_stack([np.interp(t, knots, one) for one in _plan(knots).T])
    expected = period if rate * period > 2.2 else 0.0
    assert setpoint_period(demands, 1 / rate) == pytest.approx(expected, rel=1e-4)


def test_moves_from_point_to_point_bend_at_few_setpoints() -> None:
    """Constant speed between short, hard starts and stops of all lengths: 0.25 rad/s, then 1 and 0.1."""
    knots = np.arange(-1.0, 16.0, 0.01) + 0.0037
    speed = np.interp(
        knots, [1, 1.08, 7, 7.08, 8, 8.3, 9, 9.3, 10, 10.03, 14, 14.03], [0, 1, 1, 0, 0, -4, -4, 0, 0, 0.4, 0.4, 0]
    )
    plan = np.cumsum(0.25 * speed * 0.01)
    t = np.arange(0.0, 15.0, 1 / 2000)
    assert setpoint_period(np.interp(t, knots, plan)[:, None], 1 / 2000) == pytest.approx(0.01, rel=1e-4)


@pytest.mark.parametrize("rate", [125.0, 1000.0])
def test_a_plan_and_a_standstill_have_none(rate: float) -> None:
    t = np.arange(0.0, 8.0, 1 / rate)
    assert setpoint_period(_plan(t), 1 / rate) == 0.0
    assert setpoint_period(np.zeros((1000, 2)), 1 / rate) == 0.0
    assert setpoint_period(np.full((1000, 2), np.nan), 1 / rate) == 0.0
