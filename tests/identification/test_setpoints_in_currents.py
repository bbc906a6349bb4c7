"""Rows per setpoint, seen in the currents where no model states a controller."""

from __future__ import annotations

import numpy as np
import pytest

from identification.preprocessing.setpoints_in_currents import rows_between_setpoints

RATE, JOINTS = 500.0, 3


def moved(seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
    """Row numbers (m,), accelerations (m, JOINTS) below 1 Hz, and more random numbers."""
    rng, row = np.random.default_rng(seed), np.arange(int(seconds * RATE))
    phases = 2 * np.pi * rng.uniform(0.1, 1.0, (JOINTS, 4)), rng.uniform(0.0, 6.0, (JOINTS, 4))
    return row, np.sin(row[:, None, None] / RATE * phases[0] + phases[1]).sum(axis=2), rng


def sawtooth(row: np.ndarray, rows: float, phase: float) -> np.ndarray:
    """(m, 1) of zero mean, with a step at every setpoint."""
    return ((row / rows + phase) % 1.0 - 0.5)[:, None]


@pytest.mark.parametrize("rows", range(2, 11))
def test_rows_per_setpoint_are_those_of_the_transients(rows: int) -> None:
    row, a, rng = moved(16.0, rows)
    ripple = sawtooth(row, rows, rng.uniform()) * a + rng.standard_normal(a.shape)
    assert rows_between_setpoints(ripple, a, RATE) == rows
    ripple[rng.uniform(size=len(row)) < 0.05] = np.nan
    assert rows_between_setpoints(ripple, a, RATE) == rows


@pytest.mark.parametrize("rows", [9.8, 19.6, 20.3, 7.96, 5.95])
def test_a_line_beside_that_of_a_whole_number_is_none_of_it(rows: float) -> None:
    """Of 50 Hz at 980 Hz the second harmonic is 2 Hz beside that of ten rows."""
    row, a, rng = moved(16.0, 2)
    ripple = sawtooth(row, rows, rng.uniform()) * a + 0.5 * rng.standard_normal(a.shape)
    assert rows_between_setpoints(ripple, a, RATE) == 0


@pytest.mark.parametrize("rows", [2.3, 3.7, 7.5])
def test_setpoints_whose_rate_is_no_part_of_the_sampling_rate_are_none(rows: float) -> None:
    row, a, rng = moved(16.0, 1)
    lines = sum(np.sin(2 * np.pi * k * (row / rows + 0.2)) / k for k in (1, 2, 3))
    assert rows_between_setpoints(lines[:, None] * a + 0.1 * rng.standard_normal(a.shape), a, RATE) == 0


def test_noise_the_mains_and_joints_that_stand_show_none() -> None:
    for seed in range(60):
        row, a, rng = moved(3.0 + seed % 20, seed)
        a[:, 0] = 0.0
        white = rng.standard_normal(a.shape)
        mains = np.sin(2 * np.pi * rng.uniform(49.95, 50.05) * row / RATE)[:, None]
        assert rows_between_setpoints(white + 0.9 * np.roll(white, 1, axis=0) + 3.0 * mains, a, RATE) == 0
