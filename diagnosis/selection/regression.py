"""Whitened regression y = A b + X c + e, with columns A of the chosen candidates and X of another one.

Coefficients and nonlinear parameters come from the fit set; the gain of a candidate is the fall of the squared held-out
residual.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from diagnosis.cause import EffectKey
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset, Pair
from identification.selection import Score, Split, p_of_short_blocks, p_value, shift_p_value

INDEPENDENT = 1e-3
"""Relative singular value of columns of unit length below which they are dependent: rounding and model errors."""
SPARSE_P = 1e-4
"""p-value from blocks of a second above which shorter ones, and the instants of an effect, are tested as well."""
LARGE = 0.25
"""Gain over the noise energy of a joint, for every coefficient, from which an effect is large, in however few blocks.

A joint that moves once in a recording is quick for a second or two, and a recording of some seconds has no more blocks:
their signs distinguish nothing from chance. The more coefficients, the more of another law an effect follows then.
"""
LARGEST = 1.0
"""That gain at most, however many coefficients there are."""


@dataclass(frozen=True)
class Fitted:
    """Columns fitted together.

    residual       (N,) of the fit set, (M,) of the held-out set
    basis          (N, r) basis of the columns in the fit set, orthonormal but for what is ``known`` of coefficients;
                   to_held_out (M, r): the same combinations in the held-out set
    coefficients   of all columns, in their order
    """

    residual: Split[Array]
    basis: Array
    to_held_out: Array
    coefficients: Array


def fit_together(data: Split[Dataset], chosen: Iterable[Pair]) -> Fitted:
    """Least squares of the chosen columns together; coefficients in their order."""
    pairs, (fit, held_out) = list(chosen), data
    if not pairs:
        empty = np.empty((len(fit.y), 0)), np.empty((len(held_out.y), 0))
        return Fitted(Split(fit.y, held_out.y), *empty, np.empty(0))
    a = np.hstack([pair.fit.dense(len(fit.y)) for pair in pairs])
    a_held_out = np.hstack([pair.held_out.dense(len(held_out.y)) for pair in pairs])
    # the eigenvalues of a^T a, scaled, are the squares of the singular values, at a third of the time
    gram = a.T @ a + np.diag(np.concatenate([_known(pair.fit) for pair in pairs]))
    scale = _lengths(gram)
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    keep = values > INDEPENDENT**2 * values[-1]
    # from coordinates in the basis to coefficients
    back = vectors[:, keep] / np.sqrt(values[keep]) / scale[:, None]
    basis = a @ back
    projected = basis.T @ fit.y
    to_held_out = a_held_out @ back
    residual = Split(fit.y - basis @ projected, held_out.y - to_held_out @ projected)
    return Fitted(residual, basis, to_held_out, back @ projected)


def fit_gain(columns: Columns, fitted: Fitted) -> tuple[float, Array]:
    """Fall of the squared fit error by columns conditional on those fitted, and their coefficients (k,)."""
    inside = columns.dot(fitted.basis)
    scale = _lengths(columns.gram)
    gram = (columns.gram - inside @ inside.T) / np.outer(scale, scale)
    toward = columns.dot(fitted.residual.fit) / scale
    values, vectors = np.linalg.eigh(gram)
    keep = values > INDEPENDENT**2
    along = vectors[:, keep].T @ toward
    coefficients = vectors[:, keep] @ (along / values[keep])
    return float(along @ (along / values[keep])), coefficients / scale


def _known(columns: Columns) -> Array:
    return np.zeros(columns.x.shape[1]) if columns.known is None else columns.known


def _lengths(gram: Array) -> Array:
    """(k,) lengths of columns, of which all products (k, k) are given; 1 for a column of zeros."""
    size = np.sqrt(np.diag(gram))
    size[size == 0.0] = 1.0
    return size


def score(candidate: Candidate, pair: Pair, fitted: Fitted, held_out: Dataset) -> Score[Candidate]:
    """One candidate conditional on those fitted; gains in units of the noise variance."""
    c, fall = gain_of(pair, fitted, held_out)
    return Score(
        candidate=candidate,
        gain=float(fall.sum()),
        p=chance(pair, c, fall, fitted, held_out, sparse=candidate.definition.sparse),
        blocks=held_out.by_block(fall),
        coefficients=c,
        by_joint=held_out.by_joint(fall),
        shown=max(1, round(pair.fit.determined)),
    )


def chance(pair: Pair, c: Array, fall: Array, fitted: Fitted, held_out: Dataset, *, sparse: bool = False) -> float:
    """Probability by chance of the ``fall`` (M,) of the squared held-out residual by columns of coefficients c (k,).

    By blocks of a second; of a large fall also by blocks as short as the memory of the residual along the columns
    permits; of a large fall, or a sparse effect, by the instants at which the columns act.
    """
    blocks = held_out.by_block(fall)
    p, gain = p_value(blocks), float(blocks.sum())
    large = gain > min(LARGE * np.count_nonzero(c), LARGEST) * held_out.rows
    if p <= SPARSE_P or gain <= 0.0 or not (sparse or large):
        return p
    without = fitted.residual.held_out
    predicted = pair.held_out.contribution(c, len(held_out.y))
    p = min(p, shift_p_value(held_out.by_recording(predicted), held_out.by_recording(without)))
    if large:
        remaining = residual_with(pair, c, fitted, held_out)
        products = remaining * (without - remaining)
        falls, toward = ([x.sum(axis=1) for x in held_out.by_recording(values)] for values in (fall, products))
        p = min(p, p_of_short_blocks(falls, toward, held_out.longest_block))
    return p


def gain_of(pair: Pair, fitted: Fitted, held_out: Dataset) -> tuple[Array, Array]:
    """Coefficients (k,) of columns conditional on those fitted, and the fall of the squared held-out residual."""
    _, c = fit_gain(pair.fit, fitted)
    return c, fitted.residual.held_out**2 - residual_with(pair, c, fitted, held_out) ** 2


def residual_with(pair: Pair, c: Array, fitted: Fitted, held_out: Dataset) -> Array:
    """(M,) held-out residual with columns of coefficients c (k,) added and the fitted ones refitted."""
    inside = pair.fit.dot(fitted.basis).T @ c
    without: Array = fitted.residual.held_out
    return without - pair.held_out.contribution(c, len(held_out.y)) + fitted.to_held_out @ inside


def best_of_each(
    candidates: Iterable[Candidate],
    shown: Callable[[Candidate], Columns],
    fitted: Fitted,
    excluded: Set[EffectKey],
) -> list[Candidate]:
    """For every effect at every joint that is not excluded, the candidate that fits best.

    Conditional on those fitted. shown: the candidate's columns in the fit set, at the rows in which it is judged.
    """
    of_key: dict[EffectKey, list[Candidate]] = {}
    for candidate in candidates:
        if candidate.key not in excluded:
            of_key.setdefault(candidate.key, []).append(candidate)

    def gain(candidate: Candidate) -> float:
        return fit_gain(shown(candidate), fitted)[0]

    return [
        max(alternatives, key=gain) if len(alternatives) > 1 else alternatives[0] for alternatives in of_key.values()
    ]


def side_by_side(several: Sequence[Columns]) -> Columns:
    """Columns of the same rows as those of one candidate."""
    known = None if all(c.known is None for c in several) else np.concatenate([_known(c) for c in several])
    return Columns(np.hstack([c.x for c in several]), several[0].where, known)


def at_joint(columns: Columns, joint: int | None, side: Dataset) -> Columns:
    """The columns at the rows of one joint; all of them for an effect of the whole arm."""
    if joint is None or columns.where == side.of(joint):
        return columns
    return columns.of(rows=side.of(joint))


def with_columns(fitted: Fitted, pairs: Sequence[Pair]) -> Fitted:
    """The fit with more columns, fitted to its residual."""
    for pair in pairs:
        x, x_held_out = pair.fit.dense(len(fitted.residual.fit)), pair.held_out.dense(len(fitted.residual.held_out))
        inside = fitted.basis.T @ x
        x, x_held_out = x - fitted.basis @ inside, x_held_out - fitted.to_held_out @ inside
        u, s, vt = np.linalg.svd(x, full_matrices=False)
        keep = s > 1e-4 * s[0]
        basis, to_held_out = u[:, keep], x_held_out @ (vt[keep].T / s[keep])
        projected = basis.T @ fitted.residual.fit
        fit, held_out = fitted.residual
        fitted = Fitted(
            Split(fit - basis @ projected, held_out - to_held_out @ projected),
            np.hstack([fitted.basis, basis]),
            np.hstack([fitted.to_held_out, to_held_out]),
            fitted.coefficients,
        )
    return fitted
