"""Errors of coefficients whose columns act for a few seconds, of a residual that is correlated for tenths of one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from identification.selection.cluster_covariance import cluster_covariance, slow_variance

RATE, SECONDS, ALIKE = 100, 26, 2.5
MOVING = slice(1000, 1300)
"""Rows in which the joint moves; elsewhere its std is fifty times that of the noise."""


def _beyond_two(correlation: float, *, slow: bool) -> float:
    """Share of 400 coefficients of truth 0 that are beyond two std; noise correlated over so many s."""
    rng, t = np.random.default_rng(11), np.arange(RATE * SECONDS) / RATE
    share = np.full(len(t), 0.02)
    share[MOVING] = 1.0
    column = share[:, None] * np.column_stack([np.cos(t), np.sin(t)])
    keep, beyond = np.exp(-1.0 / (RATE * correlation)), 0
    for _ in range(400):
        white = rng.normal(size=len(t) + 500)
        residual = share * signal.lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], white)[500:]
        c = np.linalg.lstsq(column, residual, rcond=None)[0]
        left = residual - column @ c
        parts = [np.split(one, [1500]) for one in (left, share)]
        variance = slow_variance(*parts, 50, ALIKE) if slow else ALIKE * np.full(len(t), np.mean(left**2))
        covariance = cluster_covariance(column, [left], np.arange(len(t)) // RATE, variance=variance)
        beyond += int(abs(c[0]) > 2.0 * np.sqrt(covariance[0, 0]))
    return beyond / 400


@pytest.mark.parametrize("correlation", [0.03, 0.14])
def test_coefficients_of_a_few_seconds_are_as_uncertain_as_slow_noise_makes_them(correlation: float) -> None:
    """By the mean square of all rows, most of which stand, 28 and 36 % are beyond two std."""
    assert _beyond_two(correlation, slow=True) < 0.15
    assert _beyond_two(correlation, slow=False) > 0.25


def test_of_white_noise_as_many_rows_count_as_one_as_filters_make_alike() -> None:
    rng, shares = np.random.default_rng(3), [np.ones(6000), np.full(3000, 0.1)]
    residuals = [share * rng.normal(size=len(share)) for share in shares]
    variance = slow_variance(residuals, shares, 50, ALIKE)
    assert variance[0] == pytest.approx(ALIKE, rel=0.1) and variance[-1] == pytest.approx(0.01 * variance[0])
    # a recording that is shorter than the longest lag has its own variance
    assert slow_variance([np.ones(1)], [np.ones(1)], 50, 1.0) == pytest.approx([1.0])
