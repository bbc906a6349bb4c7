"""Prediction of a residual by its means in bins of a variable: structure of any shape, with no law of it assumed."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array


def quantile_edges(x: Array, bins: int) -> Array:
    """(at most bins - 1,) inner edges of bins with equal numbers of the values x (m,); fewer if x has few values."""
    return np.unique(np.quantile(x, np.linspace(0, 1, bins + 1)[1:-1]))


def predicted_by_bins(x_fit: Array, y_fit: Array, x: Array, bins: int) -> Array:
    """(m, k) at x (m,): the means of y_fit (f, k) in ``bins`` bins of x_fit (f,), each with equally many of these."""
    edges = quantile_edges(x_fit, bins)
    which = np.digitize(x_fit, edges)
    count = np.maximum(np.bincount(which, minlength=len(edges) + 1), 1)
    means = [np.bincount(which, weights=column, minlength=len(edges) + 1) / count for column in y_fit.T]
    return np.stack(means, axis=1)[np.digitize(x, edges)]


def predicted_share(y: Array, predicted: Array) -> float:
    """Share of the squares of a residual y (m, k) that a prediction (m, k) takes away; below 0 where it adds some."""
    return 1.0 - float(np.sum((y - predicted) ** 2)) / max(float(np.sum(y**2)), 1e-300)
