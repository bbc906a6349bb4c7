"""Standard deviations of a least-squares fit whose residual is coloured.

The textbook formula sigma^2 (W^T W)^-1 takes rows as independent. Filters, quantisation and whatever the model lacks
make neighbouring rows say the same, and the formula too confident by a factor of two to ten. Here whole blocks of time
are resampled (moving them together over all joints): the spread of the refits is what another recording of the same
motion would give (Kuensch, Annals of Statistics 17 (1989) 1217). Each block enters by its normal equations, so that a
refit costs one small solve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats

from arm_io.types import Array
from identification.regression.equations import Equations
from identification.regression.least_squares import Fit
from identification.regression.qr import triangle_of
from identification.selection.significance import MEMORIES

REPLICATES = 400
"""Refits to blocks drawn anew: a std from them is known to 5 %."""
LEAST_BLOCKS = 12
"""Smallest number of blocks that shows their scatter."""
MOST_BLOCKS = 2500
"""Largest number of blocks: each has its own normal equations."""


@dataclass(frozen=True)
class FitUncertainty:
    """What the blocks of a fit of b parameters say of their values.

    covariance   (b, b) of the values, from ``blocks`` blocks of ``block`` s
    std          (b,) root of its diagonal, never below ``std_formula``
    std_formula  (b,) the textbook's, which takes the residuals for white noise
    information  (b, b) inverse of the formula's covariance, divided by how much too confident the formula is on the
                 whole. Unlike the blocks' own covariance, whose rank is at most their number, it can be inverted, and a
                 further fit may rest on it
    normal       W^T W (blocks, b, b) and W^T e (blocks, b) of each block
    prior        (b, b) what the fit was regularised by, as if further rows had shown it (``regularised``), or None
    by_noise     (b, b) the information without the systematic errors of the rows; None: there are none. It says what a
                 value is worth to the prediction of the rows; an arm that could exist is sought with it
    """

    covariance: Array
    std: Array
    std_formula: Array
    information: Array
    block: float
    blocks: int
    normal: tuple[Array, Array]
    prior: Array | None = None
    by_noise: Array | None = None

    @property
    def of_rows(self) -> Array:
        """(b, b) ``by_noise``, or the information where that is the same."""
        return self.information if self.by_noise is None else self.by_noise

    @cached_property
    def std_bootstrap(self) -> Array:
        """(b,) spread of refits to blocks drawn anew, with replacement.

        Half of what holds 68 % of them, since a draw may miss all blocks that show a parameter; NaN without blocks.
        """
        low, high = np.quantile(self.bootstrap(), [0.16, 0.84], axis=0)
        return np.asarray((high - low) / 2)

    def bootstrap(self) -> Array:
        """(REPLICATES, b) by how much refits to blocks drawn anew differ from the fit."""
        grams, scores = self.normal
        count = len(grams)
        if not count:
            return np.full((REPLICATES, scores.shape[1]), np.nan)
        scale = 1 / np.sqrt(np.maximum(np.abs(np.diag(grams.sum(axis=0))), 1e-300))
        drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), size=REPLICATES).astype(float)
        held = 0.0 if self.prior is None else self.prior
        pull = 0.0 if self.prior is None else scores.sum(axis=0)
        return np.array([_solve(np.tensordot(c, grams, 1) + held, c @ scores - pull, scale) for c in drawn])


def fit_uncertainty(
    columns: Array, rows: Equations, fit: Fit, *, instruments: Array | None = None, prior: Array | None = None
) -> FitUncertainty:
    """Of ``fit`` = least squares of ``rows.torque`` by ``columns`` (rows, b), or by ``instruments`` (rows, b) of these.

    prior (r, b): further rows, of weight 1 and value 0, that regularised the fit. The formula's covariance is then that
    of the posterior, which covers what smoothing takes away (Wahba, J. R. Statist. Soc. B 45(1), 1983).

    2 std covers 95 %: the factor between Student's quantile at the blocks' degrees of freedom and 1.96 is in it.
    """
    by = columns if instruments is None else instruments
    variance = float(np.sum((fit.weight * fit.residual) ** 2)) / max(len(fit.residual) - len(fit.values), 1)
    weight = fit.weight[:, None]
    root = _root(columns * weight, None if instruments is None else instruments * weight)
    held = None
    if prior is not None:
        root, held = triangle_of(np.concatenate([root, prior])), prior.T @ prior
    formula = _formula(root, variance)
    length = block_length(rows, fit.residual)
    block = _blocks(rows, length)
    count = int(block.max()) + 1
    grams, scores = _normal_equations(columns, fit, block, count, by)
    total = grams.sum(axis=0) if held is None else grams.sum(axis=0) + held
    pull = 0.0 if held is None else scores.sum(axis=0)
    covariance = _jackknife(total, grams, scores, pull)
    # Few blocks may agree by chance: no std is smaller than that for white residuals.
    blockwise = np.sqrt(np.diag(covariance))
    std = np.maximum(blockwise, formula)
    raised = std / np.maximum(blockwise, 1e-300)
    covariance = covariance * raised[:, None] * raised
    too_sure = float(np.exp(np.mean(np.log(np.maximum(std, 1e-300) / np.maximum(formula, 1e-300)))))
    information = root.T @ root / (variance * max(too_sure, 1.0) ** 2)
    by_noise = None if rows.systematic is None else information
    if rows.systematic is not None:
        shift = _systematic(total, by.T @ (weight**2 * rows.systematic))
        covariance = covariance + shift @ shift.T
        std = np.sqrt(np.diag(covariance))
        seen = information @ shift  # Woodbury: the inverse of the inverse plus shift shift^T
        information = information - seen @ np.linalg.solve(np.eye(shift.shape[1]) + shift.T @ seen, seen.T)
    return FitUncertainty(covariance, std, formula, information, length, count, (grams, scores), held, by_noise)


def _jackknife(total: Array, grams: Array, scores: Array, pull: Array | float) -> Array:
    """(b, b) covariance of the fit from refits without one block each (delete-one jackknife).

    total (b, b): normal matrix of all blocks and the prior; pull (b,): gradient that the prior takes up.
    Unlike plain resampling it stays valid where a single block determines a parameter.
    """
    count, scale = len(grams), _unit_scale(total)
    shifts = np.empty((count, len(total)))
    for b in range(count):
        shifts[b] = _solve(total - grams[b], scores.sum(axis=0) - pull - scores[b], scale)
    shifts = shifts - shifts.mean(axis=0)
    return np.asarray(student_factor(count - 1) ** 2 * (count - 1) / count * shifts.T @ shifts)


def student_factor(freedom: float) -> float:
    """Factor on a std that is known with so many degrees of freedom (at least 1), so that two of it hold 95 %.

    Student's quantile over the normal one.
    """
    return float(stats.t.ppf(0.975, max(freedom, 1)) / stats.norm.ppf(0.975))


def _systematic(total: Array, score: Array) -> Array:
    """(b, k) shifts of the fit by k torque errors that last all along, which no block differs in; score (b, k)."""
    scale = _unit_scale(total)
    return np.stack([_solve(total, column, scale) for column in score.T], axis=1)


def _unit_scale(gram: Array) -> Array:
    """(b,) scales that bring the diagonal of a normal matrix (b, b) to 1."""
    return np.asarray(1 / np.sqrt(np.maximum(np.diag(gram), 1e-300)))


def block_length(rows: Equations, residual: Array) -> float:
    """s: MEMORIES correlation times of that joint's residual which is correlated longest.

    Limited so that there are at least LEAST_BLOCKS and at most MOST_BLOCKS blocks.
    """
    longest, duration = 0.0, 0.0
    for run in np.unique(rows.run):
        of_run = rows.run == run
        duration += float(np.ptp(rows.t[of_run]))
        for j in np.unique(rows.joint[of_run]):
            of_joint = of_run & (rows.joint == j)
            if of_joint.sum() > 10:
                longest = max(longest, correlation_time(rows.t[of_joint], residual[of_joint]))
    return float(np.clip(MEMORIES * longest, duration / MOST_BLOCKS, duration / LEAST_BLOCKS))


def correlation_time(t: Array, residual: Array) -> float:
    """Integral of the autocorrelation up to its first passage through zero, s (at least one row)."""
    period = float(np.median(np.diff(t)))
    e = residual - residual.mean()
    n = len(e)
    spectrum = np.abs(np.fft.rfft(e, 2 * n)) ** 2
    correlation = np.fft.irfft(spectrum)[: n // 2]
    correlation = correlation / max(correlation[0], 1e-300)
    crossing = np.flatnonzero(correlation <= 0)
    reach = crossing[0] if len(crossing) else len(correlation)
    return period * max(1.0, float(2 * correlation[:reach].sum() - 1))


def _root(columns: Array, instruments: Array | None) -> Array:
    """Triangle R (b, b) with R^T R the inverse covariance of a fit to rows of white noise of variance 1.

    R^T R = W^T W, or W^T Z (Z^T Z)^-1 Z^T W with instruments Z.
    """
    if instruments is None:
        return triangle_of(columns)
    scale = np.linalg.norm(instruments, axis=0)
    scale[scale == 0] = 1.0
    return triangle_of(np.linalg.qr(instruments / scale)[0].T @ columns)


def _formula(root: Array, variance: float) -> Array:
    scale = np.linalg.norm(root, axis=0)
    scale[scale == 0] = 1.0
    inverse = linalg.solve_triangular(root / scale, np.eye(len(root)), check_finite=False)
    return np.asarray(np.sqrt(variance * np.sum(inverse**2, axis=1)) / scale)


def _blocks(rows: Equations, length: float) -> NDArray[np.intp]:
    """(rows,) number of the block of time each row is in, 0 .. count-1, the same for all joints."""
    first = 0
    block = np.zeros(len(rows), np.intp)
    for run in np.unique(rows.run):
        of_run = rows.run == run
        _, number = np.unique((rows.t[of_run] / max(length, 1e-9)).astype(np.intp), return_inverse=True)
        block[of_run] = first + number
        first = int(block[of_run].max()) + 1
    return block


def _normal_equations(columns: Array, fit: Fit, block: NDArray[np.intp], count: int, by: Array) -> tuple[Array, Array]:
    """Per block: W^T W (count, b, b) and W^T e (count, b) of the weighted rows.

    With the residual as e, so that a solve gives the change; Z^T W and Z^T e where Z = ``by`` are instruments.
    """
    weighted, residual = columns * fit.weight[:, None], fit.weight * fit.residual
    by = by * fit.weight[:, None]
    grams = np.empty((count, columns.shape[1], columns.shape[1]))
    scores = np.empty((count, columns.shape[1]))
    order = np.argsort(block, kind="stable")
    edges = np.searchsorted(block[order], np.arange(count + 1))
    for b in range(count):
        of_block = order[edges[b] : edges[b + 1]]
        grams[b], scores[b] = by[of_block].T @ weighted[of_block], by[of_block].T @ residual[of_block]
    return grams, scores


def _solve(gram: Array, score: Array, scale: Array) -> Array:
    """(b,) gram^-1 score, solved in units of ``scale`` (b,); least norm where a direction has no rows."""
    scaled = gram * scale[:, None] * scale
    try:
        return scale * np.linalg.solve(scaled, scale * score)
    except linalg.LinAlgError:
        return scale * (np.linalg.pinv(scaled, rcond=1e-10) @ (scale * score))
