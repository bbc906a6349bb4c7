"""The recordings of two sides in one regression, of which one hypothesis at a time may explain how they differ.

A regression per recording asks for every value at once, and a change of one is lost in what all others may have done
meanwhile. Here all recordings share one set of values, and one hypothesis at a time may differ between the sides. With
G the normal matrices of the sides and e the residual of the shared fit, its coefficients c follow from

    D^T M D c = D^T s,    M = G_after - G_after (G_before + G_after)^-1 G_after,    s = sum of x e over the rows after

(the parallel sum of both sides' information), if nothing differed but the noise of the rows (``tested``).

Another scale of a joint's currents is no change of the values: a mass beyond the joint loads other joints, too. It has
a column of its own, the torque of that joint by the values before, which the shared fit has not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from arm_io.types import Array
from comparison.regression import Fitted, Rows, Structure

RANK_TOLERANCE = 1e-6
"""Of a column's own size: combinations of a hypothesis that the two sides show."""
LEAST_BLOCK = 0.1
"""s: shorter blocks of time cost more and say no more."""
NONE = 1e-9
"""Of a column's square: what keeps values determined that no recording shows."""
PIECE = 512
"""Rows that are treated together: what they show of all hypotheses stays in the cache of the processor."""


@dataclass(frozen=True)
class Piece:
    """Consecutive rows of one recording.

    rows, after  their places; whether they are of the side after
    columns, x   (k,) which columns are not zero in all of them, and (m, k) these
    blocks, sums  (b,) their blocks of time, and (b, m) sums over the rows of each
    """

    rows: slice
    after: bool
    columns: NDArray[np.intp]
    x: Array
    blocks: NDArray[np.intp]
    sums: sparse.csr_array

    def of(self, sides: tuple[Array, Array]) -> Array:
        """(m, ...) what changes of the values (c, ...), on the side before and after, add to the rows."""
        return np.asarray(self.x @ sides[self.after][self.columns])


@dataclass(frozen=True)
class JointRegression:
    """Weighted rows of all recordings, for values in units of ``scale`` (c,).

    The last ``scales`` of the c values are changes of scale of the joints' currents, 0 before.

    x, y       (n, c) columns and (n,) torques less the model's, over the noise
    block      (n,) the block of time of each row; recording, after  (b,) of each block
    drift      (c, d) changes of the values by one standard deviation each of what differs where nothing changed
    """

    x: Array
    y: Array
    block: NDArray[np.intp]
    recording: NDArray[np.intp]
    after: NDArray[np.bool_]
    scale: Array
    drift: Array
    scales: int = 0

    @property
    def recordings(self) -> int:
        """Number of recordings, of both sides."""
        return int(self.recording.max()) + 1

    @cached_property
    def known(self) -> dict[Any, Any]:
        """What ``tested`` found of this fit, by the changes that are known."""
        return {}

    @cached_property
    def total(self) -> Array:
        """(c, c) normal matrix of all rows."""
        return self.total_after + self._normal(after=False)

    @cached_property
    def total_after(self) -> Array:
        """(c, c) that of the side after."""
        return self._normal(after=True)

    def _normal(self, *, after: bool) -> Array:
        found = np.zeros((len(self.scale), len(self.scale)))
        for piece in self.pieces:
            if piece.after == after:
                found[np.ix_(piece.columns, piece.columns)] += piece.x.T @ piece.x
        return found

    @cached_property
    def rows_after(self) -> NDArray[np.bool_]:
        """(n,) rows of the side after."""
        return np.asarray(self.after[self.block])

    @cached_property
    def moment(self) -> Array:
        """(c,) columns times torques of all rows."""
        return np.asarray(self.x.T @ self.y)

    @cached_property
    def moment_after(self) -> Array:
        """(c,) the same of the side after."""
        return np.asarray(self.x.T @ np.where(self.rows_after, self.y, 0.0))

    @cached_property
    def residual(self) -> Array:
        """(n,) of the shared fit."""
        return np.asarray(self.y - self.x @ (self.information[0] @ self.moment))

    @cached_property
    def scores(self) -> Array:
        """(c,) s: the residual of the shared fit times the columns, summed over the rows of the side after."""
        return np.asarray(self.moment_after - self.information[1] @ self.moment)

    def beside_shared(self, changes: Array) -> tuple[Array, Array]:
        """(c, ...) before and after: changes of the side after, less what the shared fit has of them."""
        shared = self.information[1].T @ changes
        return -shared, changes - shared

    @cached_property
    def pieces(self) -> list[Piece]:
        """All rows, in their order."""
        recording = self.recording[self.block]
        ends = np.flatnonzero(np.diff(recording)) + 1
        found = []
        for first, last in zip([0, *ends.tolist()], [*ends.tolist(), len(recording)]):
            found += [self._piece(start, min(start + PIECE, last)) for start in range(first, last, PIECE)]
        return found

    def _piece(self, first: int, last: int) -> Piece:
        x = self.x[first:last]
        columns = np.flatnonzero(x.any(axis=0))
        blocks, of = np.unique(self.block[first:last], return_inverse=True)
        rows = np.arange(last - first)
        sums = sparse.csr_array((np.ones(len(rows)), (of, rows)), (len(blocks), len(rows)))
        return Piece(slice(first, last), bool(self.after[blocks[0]]), columns, x[:, columns], blocks, sums)

    def explained(self, common: NDArray[np.intp], changes: Array, moment: Array, moment_after: Array) -> float:
        """Squares of torques explained by some columns, alike on both sides, and changes (c, k) of the side after.

        moment, moment_after: (c,) of these torques
        """
        across = self.total_after[common] @ changes
        gram = np.block(
            [[self.total[np.ix_(common, common)], across], [across.T, changes.T @ self.total_after @ changes]]
        )
        right = np.concatenate([moment[common], changes.T @ moment_after])
        return float(right @ np.linalg.solve(gram + NONE * np.eye(len(gram)), right))

    @cached_property
    def information(self) -> tuple[Array, Array, Array]:
        """(c, c) each: pseudo-inverse of both sides' matrix, share of the shared fit that is of the side after, M."""
        common = len(self.total) - self.scales
        inverse = np.zeros_like(self.total)
        shared = self.total[:common, :common]
        inverse[:common, :common] = np.linalg.pinv(shared + NONE * np.eye(common), hermitian=True)
        share = self.total_after @ inverse
        return inverse, share, np.asarray(self.total_after - share @ self.total_after)


def joint_regression(
    structure: Structure, data: Sequence[Rows], fits: Sequence[Fitted], is_before: NDArray[np.bool_], drift: Array
) -> JointRegression:
    """Of recordings with their own fits; ``is_before`` (n,) is True for those before.

    drift: (c, d) as of ``friction_drift``. Columns beyond those of the compared values are zero in the model, and do
    not drift. Those of the joints' scales come last.
    """
    joints = len(structure.arm)
    size = data[0].columns.shape[1] + joints
    model = np.concatenate([structure.model(), np.zeros(size - joints - structure.size)])
    square = np.array([_mean_squares(rows, fitted, joints) for rows, fitted in zip(data, fits)])
    noise = np.sqrt(np.array([np.median(of[np.isfinite(of)]) if np.isfinite(of).any() else 1.0 for of in square.T]))
    parts = [_weighted(rows, model, noise) for rows in data]
    before = _values_of([one for one, earlier in zip(parts, is_before) if earlier], model)
    x = np.concatenate([_with_scales(rows, part[:, :-1], before, joints) for rows, part in zip(data, parts)])
    y = np.concatenate([part[:, -1] for part in parts])
    # a joint at rest, or a gap that its load never crosses, determines nothing
    scale = 1.0 / _sizes(np.einsum("nc,nc->c", x, x))
    x *= scale
    blocks: list[NDArray[np.intp]] = []
    recording: list[int] = []
    for number, (rows, one) in enumerate(zip(data, fits)):
        _, block = np.unique((rows.equations.t / max(one.block, LEAST_BLOCK)).astype(np.intp), return_inverse=True)
        blocks.append(block + len(recording))
        recording += [number] * (int(block.max()) + 1)
    of, block = np.array(recording, np.intp), np.concatenate(blocks)
    drift = np.pad(drift, ((0, size - structure.size), (0, 0))) / scale[:, None]
    return JointRegression(x, y, block, of, ~is_before[of], scale, drift, joints)


def _mean_squares(rows: Rows, fitted: Fitted, joints: int) -> Array:
    """(J,) mean square residual of each joint's rows; NaN of a joint that stands."""
    residuals = [fitted.residual[rows.equations.joint == j] for j in range(joints)]
    return np.array([np.mean(residual**2) if len(residual) else np.nan for residual in residuals])


def _weighted(rows: Rows, model: Array, noise: Array) -> Array:
    """(k, c + 1) columns of a recording, and its torques less the model's, as ``_without_own``."""
    return _without_own(rows, np.column_stack([rows.columns, rows.y - rows.columns @ model]), noise)


def _without_own(rows: Rows, columns: Array, noise: Array) -> Array:
    """Columns (k, c) over the noise, without what the recording's own columns explain.

    Own columns are of one joint each, so that what is zero at a joint stays so.
    """
    joint = rows.equations.joint
    weight = 1.0 / np.maximum(noise[joint], 1e-300)[:, None]
    x = np.asarray(columns * weight)
    for j in range(len(noise)) if rows.own.shape[1] else ():
        mine = joint == j
        own = rows.own[mine] * weight[mine]
        own = own[:, own.any(axis=0)]
        if own.shape[1]:
            u, size, _ = np.linalg.svd(own, full_matrices=False)
            u = u[:, size > RANK_TOLERANCE * size[0]]
            x[mine] -= u @ (u.T @ x[mine])
    return x


def _values_of(parts: Sequence[Array], model: Array) -> Array:
    """(c,) values that some recordings show, as of ``_weighted``; those of the model where none does."""
    both = np.sum([_products(part) for part in parts], axis=0)
    square, moment = both[:-1, :-1], both[:-1, -1]
    size = _sizes(np.diag(square))
    return np.asarray(
        model
        + np.linalg.pinv(square / np.outer(size, size), rcond=RANK_TOLERANCE, hermitian=True) @ (moment / size) / size
    )


def _products(x: Array) -> Array:
    """(c, c) x^T x of rows (k, c): some at a time, as at each joint a half of the columns is zero."""
    total = np.zeros((x.shape[1], x.shape[1]))
    for first in range(0, len(x), PIECE):
        some = x[first : first + PIECE]
        columns = np.flatnonzero(some.any(axis=0))
        some = some[:, columns]
        total[np.ix_(columns, columns)] += some.T @ some
    return total


def _sizes(square: Array) -> Array:
    """(c,) lengths of columns from their squares; 1 of one that shows nothing, whose value is rounding."""
    return np.sqrt(np.where(square > 0.0, square, 1.0))


def _with_scales(rows: Rows, columns: Array, values: Array, joints: int) -> Array:
    """(k, c + J) columns as of ``_weighted`` (k, c), and the torque of each joint alone by the values (c,)."""
    of_joint = rows.equations.joint[:, None] == np.arange(joints)
    return np.concatenate([columns, (columns @ values)[:, None] * of_joint], axis=1)
