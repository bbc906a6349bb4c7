"""Two stated deviations hold the truth: a simulated Puma, a hundred times through encoders and the current chain."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.identification import IN_STEP, RATE, coverage, puma
from identification.regression.uncertainty import _jackknife


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("rate", [RATE, IN_STEP])
def test_two_deviations_hold_the_truth_in_nine_runs_of_ten(rate: float) -> None:
    arm, experiments = puma()
    figures = coverage(arm, experiments[0], 100, rate=rate)
    assert figures["coverage_parameters"] >= 50
    assert figures["coverage_worst_parameter"] >= 0.9
    # The textbook formula is the reason for all of this.
    assert figures["coverage_two_deviations_formula"] < figures["coverage_two_deviations"]


@pytest.mark.parametrize("blocks", [2, 4, 12])
def test_two_std_of_a_mean_hold_95_percent_however_few_blocks(blocks: int) -> None:
    """A constant fitted to blocks of one row each: Student's interval of a mean."""
    random = np.random.default_rng(blocks)
    inside = []
    for values in random.normal(size=(5000, blocks)):
        residual = values - values.mean()
        grams, total = np.ones((blocks, 1, 1)), np.full((1, 1), float(blocks))
        std = np.sqrt(_jackknife(total, grams, residual[:, None], 0.0)[0, 0])
        inside.append(abs(values.mean()) < 1.96 * std)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.012)
