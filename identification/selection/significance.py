"""Is a gain real, when residuals are coloured? Block scores and false-discovery control.

Encoder quantisation, filters and what the model still lacks correlate the residual over tenths of a second. Tests that
take samples for independent call more than half of all absent effects present. Summed over blocks that are long against
that correlation, the gains are independent enough to be judged by their own scatter: no noise model is needed. Blocks
of one second are long enough for any; those of a short recording may be as short as the memory of the residual permits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from arm_io.types import Array

Index = NDArray[np.intp]

BLOCK_SECONDS = 1.0
"""Length of a block: several times the longest correlation seen in practice (0.25 s)."""
MEMORIES = 4.0
"""Length of the shortest blocks over the memory (correlation time) of what they sum up.

Sums of neighbours then correlate by 1/14 (noise of first order, whose memory is twice its time constant).
"""
WINDOW = 2.5
"""Memories over which an autocorrelation is summed up: beyond, it is chance (Sokal, Functional Integration, 1997)."""
DRAWS = 20000
"""Random shifts that the chance of a prediction is counted over."""


def p_value(gains: Array) -> float:
    """Probability of a total gain at least this large if every block could as well have lost what it gained.

    gains (blocks,): fall of the squared residual in each block.

    Chernoff's bound of the sign-change distribution, min over s of exp(sum log cosh(s g_b) - s sum g_b): never too
    small, whatever the distribution of the gains, and 2^-n where all n blocks gain. Blocks with no gain and no loss
    (the arm was at rest) do not count.
    """
    gains = gains[np.abs(gains) > 1e-9 * np.max(np.abs(gains), initial=0.0)]
    total = float(gains.sum())
    if len(gains) == 0 or total <= 0.0:
        return 1.0
    size = np.abs(gains) / np.max(np.abs(gains))
    share = total / float(np.max(np.abs(gains)))

    def bound(log_s: float) -> float:
        x = np.exp(log_s) * size
        log_cosh = x + np.log1p(np.exp(-2 * x)) - np.log(2.0)
        return float(log_cosh.sum() - np.exp(log_s) * share)

    smallest = float(np.min(size))
    minimum = optimize.minimize_scalar(bound, bounds=(-10.0, np.log(40.0 / smallest)), method="bounded")
    return float(min(1.0, np.exp(minimum.fun)))


def memory(series: Sequence[Array], longest: int) -> float:
    """Rows of series (m,) each that count as one: their integrated autocorrelation, at most ``longest``."""
    products = np.zeros(longest + 1)
    for values in series:
        spectrum = np.abs(np.fft.rfft(values, len(values) + longest + 1)) ** 2
        products += np.fft.irfft(spectrum, len(values) + longest + 1)[: longest + 1]
    if products[0] <= 0.0:
        return float(longest)
    rows = 1.0 + 2.0 * np.cumsum(products[1:] / products[0])
    enough = np.flatnonzero(np.arange(1, longest + 1) >= WINDOW * rows)
    return float(np.clip(rows[enough[0]] if len(enough) else longest, 1.0, longest))


def p_of_short_blocks(falls: Sequence[Array], remaining: Sequence[Array], longest: int) -> float:
    """``p_value`` of the fall (m,) of the squared residual of each recording, in short independent blocks.

    remaining (m,): what is left times what was explained, whose sign is chance if nothing was there. Its memory sets
    how long blocks are. longest: rows of one second.
    """
    length = int(np.clip(np.ceil(MEMORIES * memory(remaining, longest)), 1, longest))
    return p_value(np.concatenate([np.add.reduceat(fall, np.arange(0, len(fall), length)) for fall in falls]))


def shift_p_value(predicted: Sequence[Array], residual: Sequence[Array]) -> float:
    """Probability that events predicted at other times gain as much.

    predicted, residual (m, n): whitened, of each recording.

    Gains 2 x.r - x.x of the prediction turned round within each recording by a random number of rows, against the gain
    where it stands. Few events that explain much cannot show it by the sign of blocks; that they are where they should
    be is the stronger evidence. The colour of the residual is kept.
    """
    rng = np.random.default_rng(0)
    shifted, in_place, size = np.zeros(DRAWS), 0.0, 0.0
    for x, r in zip(predicted, residual):
        spectrum = np.sum(np.conj(np.fft.rfft(x, axis=0)) * np.fft.rfft(r, axis=0), axis=1)
        inner = np.fft.irfft(spectrum, len(x))  # x turned round by k rows, times r
        in_place += float(inner[0])
        shifted += inner[rng.integers(0, len(x), DRAWS)]
        size += float(np.sum(x**2))
    if 2 * in_place <= size:
        return 1.0
    return float((1 + np.count_nonzero(shifted >= in_place)) / (1 + DRAWS))
