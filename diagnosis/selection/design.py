"""Datasets of a selection from whitened residuals, and columns of candidates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.run import Run
from identification.selection import Split


@dataclass(frozen=True)
class Dataset:
    """Whitened residuals of a set of recordings (fit or held out), joint after joint.

    y, block   (n * rows,) residuals, and the number of the block that each is in
    together   the same recordings, consecutive ones with the same setup merged
    corrected  (n,) energy, by joint, of the corrections that an exact model has made to y
    """

    runs: tuple[Run, ...]
    together: tuple[Run, ...]
    y: Array
    block: NDArray[np.intp]
    rows: int
    corrected: Array | float = 0.0

    def of(self, joint: int) -> slice:
        """Rows of a joint (1-based) in ``y``."""
        return slice((joint - 1) * self.rows, joint * self.rows)

    def at_joint(self, name: str, joint: int) -> Array:
        """(rows,) a field (m, n) of the runs at a joint (1-based)."""
        values: Array = np.concatenate([getattr(run, name)[:, joint - 1] for run in self.runs])
        return values

    def whitened(self, values: Array, joint: int) -> Array:
        """(rows, k): values (rows, k) A at a joint (1-based), over their std as its residual is (``Run.whiten``)."""
        return np.concatenate([run.whiten_at(part, joint) for run, part in zip(self.runs, self.split(values))])

    def split(self, values: Array, axis: int = 0) -> list[Array]:
        """Values whose ``axis`` is the rows of a joint, cut into those of each recording."""
        return np.split(values, np.cumsum([len(run.t) for run in self.runs])[:-1], axis)

    def by_recording(self, values: Array) -> list[Array]:
        """Values (n * rows,) as (m, n) of each recording."""
        return self.split(values.reshape(-1, self.rows).T)

    def comparable(self, joint: int) -> NDArray[np.bool_]:
        """(rows,) where the residual of a joint (1-based) is compared; see ``comparable_rows``."""
        rows: NDArray[np.bool_] = np.concatenate([comparable_rows(run)[:, joint - 1] for run in self.runs])
        return rows

    def by_block(self, values: Array) -> Array:
        """(blocks,) sums of values (n * rows,), all joints together."""
        # rows of a block follow one another
        sums = np.add.reduceat(values.reshape(-1, self.rows).sum(axis=0), self._first)
        return np.bincount(self.block[self._first], weights=sums).astype(float)

    @cached_property
    def _first(self) -> NDArray[np.intp]:
        """The row of a joint in which each block begins."""
        return np.flatnonzero(np.diff(self.block[: self.rows], prepend=-1))

    @property
    def longest_block(self) -> int:
        """Rows of a joint in the longest block."""
        return int(np.bincount(self.block[: self.rows]).max())

    def by_joint(self, values: Array) -> Array:
        """(n,) sums of values (n * rows,)."""
        sums: Array = values.reshape(-1, self.rows).sum(axis=1)
        return sums


@dataclass(frozen=True)
class Columns:
    """Whitened columns x (rows, k) of one candidate at the rows ``where`` of ``y``; 0 at all others.

    known: (k,) inverse variance of coefficients that are zero but for so much, whatever the data; None: nothing is
    """

    x: Array
    where: slice
    known: Array | None = None

    @cached_property
    def gram(self) -> Array:
        """(k, k) products of the columns with each other, and ``known``: every round of a selection asks for them."""
        products: Array = self.x.T @ self.x
        return products if self.known is None else products + np.diag(self.known)

    @property
    def determined(self) -> float:
        """Number of coefficients that these rows determine: of two that are ``known`` as closely anyway, one."""
        if self.known is None:
            return float(self.x.shape[1])
        over = 1.0 / np.sqrt(self.known)
        shown = np.linalg.eigvalsh(self.x.T @ self.x * np.outer(over, over))
        return float(np.sum(shown / (1.0 + shown)))

    def of(self, rows: slice | None = None, columns: slice | None = None) -> Columns:
        """Some of the rows, by their places in ``y``, or some of the columns."""
        x, known, where = self.x, self.known, self.where
        if rows is not None:
            x, where = x[rows.start - where.start : rows.stop - where.start], rows
        if columns is not None:
            x, known = x[:, columns], None if known is None else known[columns]
        return Columns(x, where, known)

    def without(self, rows: slice) -> Columns:
        """The columns, 0 at some of the rows ``where`` they are, by their places in ``y``."""
        x = self.x.copy()
        x[rows.start - self.where.start : rows.stop - self.where.start] = 0.0
        return Columns(x, self.where, self.known)

    def expecting(self, share: float) -> Columns:
        """The columns with coefficients whose ``known`` std is such a share of what it is."""
        return self if self.known is None else Columns(self.x, self.where, self.known / share**2)

    def dot(self, values: Array) -> Array:
        """x^T other, for other (N,) or (N, r)."""
        product: Array = self.x.T @ values[self.where]
        return product

    def contribution(self, coefficients: Array, length: int) -> Array:
        """(length,) x coefficients, over all rows of ``y``."""
        values = np.zeros(length)
        values[self.where] = self.x @ coefficients
        return values

    def dense(self, length: int) -> Array:
        """(length, k): the columns over all rows of ``y``."""
        columns = np.zeros((length, self.x.shape[1]))
        columns[self.where] = self.x
        return columns


Pair = Split[Columns]
"""Columns of one candidate in the fit set and in the held-out set."""


def joined(data: Split[Dataset], y: Split[Array]) -> Dataset:
    """Both sides as one, the fitted recordings first, with residuals ``y`` (n * rows,) of each."""
    fit, held_out = data
    by_joint = np.hstack([values.reshape(-1, side.rows) for values, side in zip(y, data)])
    held_out_block = held_out.block[: held_out.rows] + fit.block.max() + 1
    return Dataset(
        (*fit.runs, *held_out.runs),
        (*fit.together, *held_out.together),
        by_joint.ravel(),
        np.tile(np.concatenate([fit.block[: fit.rows], held_out_block]), len(by_joint)),
        fit.rows + held_out.rows,
    )
