"""Covariance of least-squares coefficients whose residual is correlated within clusters of rows.

A cluster is a block of time, or a cell of a motion.

The sandwich of Liang & Zeger (Biometrika 73, 1986): with e the residual, x the columns and g a cluster,

    C = B (sum_g s_g s_g^T) B  G / (G - k),    s_g = x_g^T e_g,    B = (x^T x)^+

G / (G - k), of G clusters and k coefficients, is the correction for few clusters: the residual of a fit is smaller than
the error. A column that acts in few clusters follows their errors, so that s_g is next to nothing: added is what
errors of a given variance make that are alike in all of its rows; of errors that change more slowly than rows, that
variance is their autocovariance over all rows (``slow_variance``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from identification.selection.least_squares import scaled
from identification.selection.significance import Index


def numbered_on(blocks: Sequence[Index]) -> Index:
    """(sum of m,) numbers of the blocks of several recordings, (m,) each from 0, one recording after the other."""
    firsts = np.cumsum([0, *(int(own[-1]) + 1 for own in blocks)])
    return np.concatenate([own + first for own, first in zip(blocks, firsts)])


def cluster_covariance(
    columns: Array,
    residuals: Sequence[Array],
    cluster: Index,
    *,
    independent: float = 1e-5,
    unknown: Array | None = None,
    variance: Array | None = None,
) -> Array:
    """(k, k) covariance of the coefficients of ``columns`` (m, k).

    residuals    (m,) each: errors that are independent of one another, and from cluster to cluster
    cluster      (m,) number of every row's cluster, from 0
    independent  singular value of the scaled columns below which the data says nothing of a direction
    unknown      (k,) std of the coefficients in directions that the data says nothing of; default: 0
    variance     (m,) of errors that are alike in all clusters, times the rows that count for one; default: 0
    """
    x, size = scaled(columns)
    values, vectors = np.linalg.eigh(x.T @ x)
    seen = values > independent**2
    bread = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
    meat = np.zeros_like(bread)
    clusters = int(cluster.max()) + 1
    for residual in residuals:
        scores = np.stack([np.bincount(cluster, column * residual, clusters) for column in x.T], axis=1)
        meat += scores.T @ scores
    covariance = bread @ meat @ bread * clusters / max(clusters - x.shape[1], 1)
    if variance is not None:
        covariance = covariance + bread @ ((x.T * variance) @ x) @ bread
    if unknown is not None:
        unseen = vectors[:, ~seen] @ vectors[:, ~seen].T
        covariance = covariance + unseen * (unknown * size) ** 2 @ unseen
    return np.asarray(covariance / np.outer(size, size), float)


def slow_variance(residuals: Sequence[Array], shares: Sequence[Array], longest: int, alike: float) -> Array:
    """(sum of m,) variance of every row of residuals (m,) of several recordings, times the rows that count as one.

    shares   (m,) each: std that noise has in a row, of 1 where it counts in full
    longest  rows of lag over which residuals may be correlated
    alike    rows that filters make one: no fewer count as one
    """
    lags = range(longest + 1)
    count = [max(sum(_product(one, lag) for one in shares), 1e-300) for lag in lags]
    covariance = np.array([sum(_product(one, lag) for one in residuals) / count[lag] for lag in lags])
    density = 2.0 * float(covariance @ (1.0 - np.array(lags) / (longest + 1))) - covariance[0]
    return np.asarray(max(density, alike * covariance[0]) * np.concatenate(shares) ** 2)


def _product(values: Array, lag: int) -> float:
    """Of values (m,) with themselves, so many rows later."""
    return float(values[: len(values) - lag] @ values[lag:]) if lag < len(values) else 0.0
