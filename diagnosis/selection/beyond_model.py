"""Whether columns are significant beyond the stated uncertainty of a model, in the rows of any instrument.

    y = A a + X c + L u + e,    u ~ N(0, 1),

with columns A of the other causes, X of the effect, and L of the independent errors of the model, one standard
deviation each. a, c and u are fitted together, u against its prior (generalised least squares written as a regression
with further rows u = 0; Theil & Goldberger, Int. Economic Review 2, 1961). c is significant if it differs from zero by
more than its covariance allows (Wald, F distribution).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats

from arm_io.types import Array
from diagnosis.selection.regression import INDEPENDENT

BEYOND_MODEL = 1e-3
"""Probability that an effect looks as it does while only the model is wrong, within what is known of it, at most."""
SMALLEST_PROBABILITY = 1e-300
"""Probability below which numbers end."""


@dataclass(frozen=True)
class Apart:
    """Columns (N, k) made perpendicular to all others, as independent combinations of unit length beside them.

    coefficients  (k,); of_noise, of_model: (k, k) their covariance by the residual, and by the errors of the model
    """

    columns: Array
    coefficients: Array
    of_noise: Array
    of_model: Array


@dataclass(frozen=True)
class Evidence:
    """Rows of an instrument (N,): what is to be explained, and what explains some of it already.

    y          (N,) residual over its noise
    free       (N, b) columns of the other causes
    directions (N, r) change of y by each independent error of the model, of one standard deviation
    block      (N,) number of the block of every row, from 0: residuals of different blocks are independent
    alike      rows that count for one, as filters leave them
    channel    (N,) from 0: rows of one channel are equally noisy, of two they need not be; None: all are of one
    """

    y: Array
    free: Array
    directions: Array
    block: NDArray[np.intp]
    alike: float = 1.0
    channel: NDArray[np.intp] | None = None

    @cached_property
    def _others(self) -> Array:
        """(N, b + r)."""
        return np.hstack([self.free, self.directions])

    @cached_property
    def _inverse(self) -> Array:
        """(b + r, b + r) inverse of the normal matrix of all others, with the prior of the errors."""
        gram = self._others.T @ self._others
        gram[np.diag_indices(len(gram))] += np.arange(len(gram)) >= self.free.shape[1]
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        return np.asarray(linalg.pinvh(gram / np.outer(scale, scale), rtol=1e-9) / np.outer(scale, scale))

    @cached_property
    def residual(self) -> Array:
        """(N,) what is left with all others fitted."""
        return np.asarray(self.y - self._others @ (self._inverse @ (self._others.T @ self.y)))

    def apart(self, x: Array) -> Apart | None:
        """Columns x (N, k) beside all others; None where they do not differ from these."""
        along = self._inverse @ (self._others.T @ x)
        perpendicular = x - self._others @ along
        gram, size = perpendicular.T @ x, np.sqrt(np.maximum(np.sum(x**2, axis=0), 1e-300))
        values, vectors = np.linalg.eigh((gram + gram.T) / 2 / np.outer(size, size))
        independent = values > INDEPENDENT**2
        if not independent.any():
            return None
        turn = vectors[:, independent] / np.sqrt(values[independent]) / size[:, None]
        perpendicular, along = perpendicular @ turn, along[self.free.shape[1] :] @ turn
        # beside the rows u = 0 of the prior, too, the columns are perpendicular to all others
        c = np.asarray(perpendicular.T @ self.y)
        return Apart(perpendicular, c, self._of_noise(perpendicular, c), np.asarray(along.T @ along))

    def chance(self, x: Array, further: Callable[[Array], Array] | None = None) -> float:
        """Probability that columns x (N, k) look as they do without the effect that they are of.

        further: of columns (N, k) perpendicular to all others, what else is in the covariance (k, k) of their
        coefficients.
        """
        apart = self.apart(x)
        if apart is None:
            return 1.0
        c, covariance = apart.coefficients, apart.of_noise + apart.of_model
        freedom = max(int(self.block.max()) + 1 - len(c), 1)
        if further is not None:
            covariance = covariance + further(apart.columns)
        wald = float(c @ linalg.pinvh(covariance) @ c)
        return float(stats.f.sf(wald / len(c), len(c), freedom))

    def _of_noise(self, perpendicular: Array, c: Array) -> Array:
        """(k, k) covariance of the coefficients c (k,) of columns ``perpendicular`` by the residual.

        Clustered by block, and as if it were alike everywhere in a channel: columns that act in few blocks show little
        of it.
        """
        remaining, clusters = self.residual - perpendicular @ c, int(self.block.max()) + 1
        scores = np.stack([np.bincount(self.block, column * remaining, clusters) for column in perpendicular.T], axis=1)
        # what the prior holds back is in all of them
        scores -= scores.mean(axis=0)
        channel = np.zeros(len(remaining), np.intp) if self.channel is None else self.channel
        noise = np.bincount(channel, remaining**2) / np.maximum(np.bincount(channel), 1)
        alike = self.alike * (perpendicular * noise[channel, None]).T @ perpendicular
        return np.asarray(scores.T @ scores * clusters / max(clusters - len(c), 1) + alike)


def in_deviations(chance: float) -> float:
    """Standard deviations of a normal quantity that is as far from zero with this probability."""
    return float(stats.norm.isf(max(chance, SMALLEST_PROBABILITY) / 2))
