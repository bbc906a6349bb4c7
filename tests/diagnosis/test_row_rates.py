"""What is counted per row or per second is right at every rate of rows: 250 rows/s keep 125, 333 keep 111."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.closed_loop.clear_errors import _of_blocks
from diagnosis.residual.filters import COMPARE_BAND, kept_rows, low_pass, rate_along, rate_kept

RATES = (140.0, 250.0, 333.0, 500.0, 1000.0)


@pytest.mark.parametrize("rate", [140.0, 250.0, 1000.0])
def test_rows_that_count_as_one(rate: float) -> None:
    """The mean of kept rows of filtered noise scatters as that of rows / ``Run.alike`` values.

    The filter's edges make it some 15 % more at any rate.
    """
    noise = np.random.default_rng(1).standard_normal((int(4.0 * rate), 600))
    rows = low_pass(noise, COMPARE_BAND, rate)[kept_rows(rate)]
    inflated = len(rows) * np.var(rows.mean(axis=0)) / np.mean(rows**2)
    assert 1.0 < inflated / (rate_kept(rate) / (2.0 * COMPARE_BAND)) < 1.3


@pytest.mark.parametrize("rate", RATES)
def test_a_block_is_a_second(rate: float) -> None:
    """An error in every other second is in every other block, to the end of a minute."""
    t = np.arange(int(60.0 * rate))[kept_rows(rate)] / rate
    t -= t[0]
    error = (np.floor(t) % 2)[:, None]
    blocks = _of_blocks(error, np.ones(error.shape, bool), round(rate_kept(rate)))[:, 0]
    np.testing.assert_allclose(blocks[::2], 0.0, atol=0.26)
    np.testing.assert_allclose(blocks[1::2], 1.0, atol=0.26)


def test_derivatives_at_250_rows_per_second() -> None:
    """Of a wave of 30 Hz, the highest in the velocities of link encoders; differences of rows are 9 % too small."""
    t = np.arange(0.0, 2.0, 1 / 250.0)
    w = 2 * np.pi * 30.0
    inner = slice(50, -50)
    off = rate_along(np.sin(w * t)[:, None], 1 / 250.0)[inner, 0] - w * np.cos(w * t)[inner]
    assert np.abs(off).max() < 0.01 * w
