"""Whether recordings contradict each other on the values of a cause, by what each of them says alone.

A property of an arm is the same in every recording: the coefficients that single recordings give agree within their
covariances. Their weighted distance from the common mean is chi-squared distributed if they do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from arm_io.types import Array

CHANCE = 1e-3
"""Probability of differences that large by chance, over all causes, below which recordings contradict each other."""
SAME = 0.05
"""Relative difference of values that is no contradiction: first-order columns are not better."""


@dataclass(frozen=True)
class SingleEstimate:
    """Coefficients (c,) by one recording alone, and their covariance (c, c)."""

    name: str
    values: Array
    covariance: Array


def chance_of(estimates: Sequence[SingleEstimate], place: slice) -> float:
    """Probability that coefficients at ``place`` differ as they do between recordings, were they the same in all."""
    precisions = [np.linalg.pinv(estimate.covariance[place, place]) for estimate in estimates]
    mean = np.linalg.pinv(np.sum(precisions, axis=0)) @ sum(
        p @ estimate.values[place] for p, estimate in zip(precisions, estimates)
    )
    differences = [estimate.values[place] - mean for estimate in estimates]
    distance = float(sum(d @ p @ d for d, p in zip(differences, precisions)))
    return float(stats.chi2.sf(distance, (len(estimates) - 1) * len(mean)))
