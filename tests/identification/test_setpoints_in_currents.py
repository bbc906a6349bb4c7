"""Whether currents show setpoints, and refute those that a model states."""

from __future__ import annotations

import numpy as np
import pytest

from identification.preprocessing.setpoints_in_currents import rows_against, rows_between_setpoints


def _servo(period: float, rate: float, seconds: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """(m, 1) A, rad/s2: transients of 2 ms at setpoints every ``period`` s, as large as the acceleration; and noise."""
    t = np.arange(int(seconds * rate)) / rate
    acceleration = 3.0 * np.sin(2 * np.pi * 0.3 * t) + 2.0 * np.sin(2 * np.pi * 0.7 * t + 1.0)
    transients = acceleration * np.exp(-np.mod(t + 0.0007, period) / 0.002)
    slow = acceleration * np.mean(np.exp(-np.arange(0.0, period, 1e-5) / 0.002))
    ripple = 0.02 * (transients - slow) + 0.005 * np.random.default_rng(1).standard_normal(len(t))
    return ripple[:, None], acceleration[:, None]


@pytest.mark.parametrize(
    ("period", "rate", "stated"), [(0.02, 200.0, 0.028), (0.016, 500.0, 0.028), (0.01, 500.0, 0.014)]
)
def test_currents_refute_setpoints_that_an_arm_does_not_have(period: float, rate: float, stated: float) -> None:
    assert rows_against(stated, *_servo(period, rate), rate) == round(period * rate)


@pytest.mark.parametrize(
    ("period", "rate"), [(0.02, 200.0), (0.028, 1000.0), (0.028, 500.0), (0.028, 200.0), (0.004, 200.0), (0.005, 200.0)]
)
def test_currents_confirm_setpoints_that_come_as_stated(period: float, rate: float) -> None:
    """Also where other lines than the first lie at a whole number of rows: every fourth of 28 ms at 1 kHz is at 7."""
    assert rows_against(period, *_servo(period, rate), rate) == 0


def test_currents_without_lines_refute_nothing() -> None:
    ripple, acceleration = _servo(0.02, 200.0)
    noise = 0.005 * np.random.default_rng(2).standard_normal(ripple.shape)
    assert rows_between_setpoints(noise, acceleration, 200.0) == 0
    assert rows_against(0.028, noise, acceleration, 200.0) == 0
