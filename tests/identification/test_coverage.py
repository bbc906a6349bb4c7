"""Two stated deviations hold the truth: a simulated Puma, a hundred times through encoders and the current chain."""

from __future__ import annotations

import pytest

from benchmarks.identification import IN_STEP, RATE, coverage, puma


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
