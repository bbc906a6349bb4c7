"""Is a gain real, when residuals are coloured? Block scores and false-discovery control.

Encoder quantisation, filters and what the model still lacks correlate the residual over tenths of a second. Tests that take samples for
independent call more than half of all absent effects present. Summed over blocks that are long against that correlation, the gains are
independent enough to be judged by their own scatter: no noise model is needed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
Index = NDArray[np.intp]

BLOCK_SECONDS = 1.0
"""Length of a block: several times the longest correlation seen in practice (0.25 s)."""


def block_sums(values: Array, block: Index, blocks: int) -> Array:
    """Sums of ``values`` (n,) over blocks numbered by ``block`` (n,) in 0..blocks-1; returns (blocks,)."""
    sums: Array = np.bincount(block, weights=values, minlength=blocks).astype(float)
    return sums


def score(gains: Array) -> float:
    """Block score s = sum g_b / sqrt(sum g_b^2) of gains (blocks,), by sign symmetry about N(0, 1) under no effect.

    Blocks with no gain and no loss (the arm stood still) do not count. 0 where there is nothing to judge. A single
    block gives at most 1 and eight at most 2.8: few blocks can never look certain.
    """
    gains = gains[gains != 0.0]
    scale = float(np.sqrt(np.sum(gains**2)))
    return float(np.sum(gains) / scale) if scale > 0 else 0.0


def p_value(gains: Array) -> float:
    """One-sided probability of a total gain at least this large if gains were as often losses.

    Exact distribution of the self-normalised sum is bounded by Student's t with n - 1 degrees of freedom after
    t = s sqrt((n - 1) / (n - s^2)) (Efron, JASA 64, 1969, symmetric case).
    """
    gains = gains[gains != 0.0]
    n = len(gains)
    if n < 2:
        return 1.0
    s = score(gains)
    if s * s >= n:
        return float(0.5**n)
    t = s * np.sqrt((n - 1) / (n - s * s))
    return float(stats.t.sf(t, n - 1))


def benjamini_hochberg(p: Array) -> Array:
    """Adjusted p-values (q-values) of Benjamini & Hochberg (JRSS B 57, 1995); same order as ``p`` (m,)."""
    m = len(p)
    if m == 0:
        return np.empty(0)
    order = np.argsort(p)
    ranked = p[order] * m / np.arange(1, m + 1)
    adjusted = np.minimum.accumulate(ranked[::-1])[::-1]
    q = np.empty(m)
    q[order] = np.minimum(adjusted, 1.0)
    return q
