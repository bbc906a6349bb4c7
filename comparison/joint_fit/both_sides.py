"""The recordings of two sides in one regression: what one hypothesis explains, if nothing else changed.

A regression per recording asks for every value at once, and a change of one is lost in what all others may have done
meanwhile. Here all recordings share one set of values, and one hypothesis at a time may differ between the sides. With
G the normal matrices of the sides and e the residual of the shared fit, its coefficients c follow from

    D^T M D c = D^T s,    M = G_after - G_after (G_before + G_after)^-1 G_after,    s = sum of x e over the rows after

(the parallel sum of both sides' information). Their covariance is that of sums over blocks of time, times what the sums
over whole recordings scatter beyond it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from arm_io.types import Array
from comparison.joint_fit.hypotheses import Hypothesis
from comparison.regression import Fitted, Rows, Structure
from comparison.significance import moderate

SHOWN = 1e-6
"""Of a column's own size: combinations of a hypothesis that the two sides show."""
LEAST_BLOCK = 0.1
"""s: shorter blocks of time cost more and say no more."""
NONE = 1e-9
"""Of a column's square: what keeps values determined that no recording shows."""


@dataclass(frozen=True)
class Both:
    """Weighted normal equations per block of time, for values in units of ``scale`` (c,).

    grams (b, c, c), scores (b, c) of blocks, relative to the values of the model; recording (b,) and after (b,) of each
    rows   per recording (k, c) columns and (k,) torques less the model's, over the noise
    """

    grams: Array
    scores: Array
    recording: NDArray[np.intp]
    after: NDArray[np.bool_]
    scale: Array
    rows: Sequence[tuple[Array, Array]]

    @property
    def recordings(self) -> int:
        return int(self.recording.max()) + 1

    def weighed(self) -> tuple[Array, Array, Array]:
        """(c, c) each: pseudo-inverse of both sides' matrix, share of the shared fit that is of the side after, M."""
        total, after = self.grams.sum(axis=0), self.grams[self.after].sum(axis=0)
        inverse = np.linalg.pinv(total + NONE * np.eye(len(total)), hermitian=True)
        share = after @ inverse
        return inverse, share, after - share @ after


@dataclass(frozen=True)
class Tested:
    """What a hypothesis explains.

    directions, coefficients, covariance  (c, k), (k,) and (k, k): the combinations of it that both sides show
    gain     squared residual, in units of the noise of white rows, that it removes
    log_p    of its chance
    """

    hypothesis: Hypothesis
    directions: Array
    coefficients: Array
    covariance: Array
    gain: float
    log_p: float

    @property
    def changes(self) -> Array:
        """(c,) of the compared values."""
        return np.asarray(self.directions @ self.coefficients)

    def seen_by(self, maps: Array) -> tuple[Array, Array]:
        """Change and std (r,) of quantities that follow from the values by ``maps`` (r, c)."""
        along = maps @ self.directions
        variance = np.sum(along @ self.covariance * along, axis=1)
        return along @ self.coefficients, np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class _Raw:
    """Coefficients (k,) of independent directions (c, k), scaled; covariance (k, k) by blocks; scatter over it.

    freedom  degrees of freedom by the blocks of both sides that show the coefficients
    """

    directions: Array
    coefficients: Array
    covariance: Array
    scatter: float
    gain: float
    freedom: float


def both_sides(structure: Structure, data: Sequence[Rows], fits: Sequence[Fitted], side: NDArray[np.bool_]) -> Both:
    """Of recordings with their own fits; ``side`` (n,) is True for those before.

    Columns beyond those of the compared values are zero in the model.
    """
    size, joints = data[0].columns.shape[1], len(structure.arm)
    model = np.concatenate([structure.model(), np.zeros(size - structure.size)])
    square = np.array([_spread(rows, one, joints) for rows, one in zip(data, fits)])
    noise = np.sqrt(np.array([np.median(of[np.isfinite(of)]) if np.isfinite(of).any() else 1.0 for of in square.T]))
    parts = [_weighted(rows, model, noise) for rows in data]
    square = sum((x**2).sum(axis=0) for x, _ in parts)
    # of a joint that stands, or a gap that its load never crosses, nothing is shown
    scale = 1.0 / np.sqrt(np.where(square > 0.0, square, 1.0))
    grams, scores, recording = [], [], []
    for number, ((x, y), rows, one) in enumerate(zip(parts, data, fits)):
        _, block = np.unique((rows.equations.t / max(one.block, LEAST_BLOCK)).astype(np.intp), return_inverse=True)
        for b in range(int(block.max()) + 1):
            mine = x[block == b] * scale
            grams.append(mine.T @ mine)
            scores.append(mine.T @ y[block == b])
            recording.append(number)
    of = np.array(recording, np.intp)
    return Both(np.array(grams), np.array(scores), of, ~side[of], scale, parts)


def _spread(rows: Rows, fitted: Fitted, joints: int) -> Array:
    """(J,) mean square residual of each joint's rows; NaN of a joint that stands."""
    of = [fitted.residual[rows.equations.joint == j] for j in range(joints)]
    return np.array([np.mean(mine**2) if len(mine) else np.nan for mine in of])


def _weighted(rows: Rows, model: Array, noise: Array) -> tuple[Array, Array]:
    """Columns and torques of a recording over the noise, without what its own columns explain."""
    weight = 1.0 / np.maximum(noise[rows.equations.joint], 1e-300)
    x, y = rows.columns * weight[:, None], (rows.y - rows.columns @ model) * weight
    if rows.own.shape[1]:
        u, size, _ = np.linalg.svd(rows.own * weight[:, None], full_matrices=False)
        u = u[:, size > SHOWN * max(size[0], 1e-300)]
        x, y = x - u @ (u.T @ x), y - u @ (u.T @ y)
    return x, y


def left_of(both: Both, found: Sequence[Tested]) -> list[Array]:
    """(k,) per recording: what the shared fit with the changes ``found`` leaves of its rows, over their noise."""
    values, changes = _shared(both, found)
    late = [bool(both.after[both.recording == k].any()) for k in range(both.recordings)]
    return [y - (x * both.scale) @ (values + changes if after else values) for (x, y), after in zip(both.rows, late)]


def _shared(both: Both, found: Sequence[Tested]) -> tuple[Array, Array]:
    """(c,) scaled: the values of the side before, less the model's, and the changes ``found``."""
    changes = sum((one.changes for one in found), np.zeros(len(both.scale))) / both.scale
    scores = both.scores - np.where(both.after[:, None], both.grams @ changes, 0.0)
    return both.weighed()[0] @ scores.sum(axis=0), changes


def shared_values(both: Both, model: Array, found: Sequence[Tested]) -> tuple[Array, Array]:
    """(c,) values of the side before, with the changes ``found``, and their covariance (c, c), of white rows.

    model: (c,) values of the model.
    """
    values, _ = _shared(both, found)
    return model + both.scale * values, both.weighed()[0] * both.scale[:, None] * both.scale


def tested(both: Both, every: Sequence[Hypothesis], chosen: Sequence[Hypothesis]) -> list[Tested]:
    """What each of ``every`` explains beside those that are ``chosen``."""
    inverse, share, m = both.weighed()
    known = np.concatenate([np.empty((len(m), 0)), *(one.directions for one in chosen)], axis=1) / both.scale[:, None]
    apart = np.linalg.pinv(known.T @ m @ known, hermitian=True, rcond=SHOWN) @ known.T if known.shape[1] else known.T
    found = known @ (apart @ (both.scores[both.after].sum(axis=0) - share @ both.scores.sum(axis=0)))
    scores = both.scores - np.where(both.after[:, None], both.grams @ found, 0.0)
    scores = scores - both.grams @ (inverse @ scores.sum(axis=0))
    raw = []
    for one in every:
        directions = one.directions / both.scale[:, None]
        raw.append(_raw(both, scores, directions - known @ (apart @ (m @ directions)), (inverse, share, m)))
    return _judged(both, every, raw)


def _raw(both: Both, scores: Array, directions: Array, weighed: tuple[Array, Array, Array]) -> _Raw | None:
    """``scores`` (b, c) of blocks at the shared fit; None where the sides do not show the hypothesis."""
    inverse, share, m = weighed
    size, axes = np.linalg.eigh(directions.T @ m @ directions)
    kept = size > SHOWN * max(float(np.sum(directions**2)), 1e-300) / len(size)
    if not kept.any():
        return None
    along, size = directions @ axes[:, kept], size[kept]
    coefficients = along.T @ scores[both.after].sum(axis=0) / size
    # the residual of the fit in which it has changed
    left = scores - np.where(both.after[:, None], both.grams @ (along @ coefficients), 0.0)
    left = left - both.grams @ (inverse @ left.sum(axis=0))
    sums = np.where(both.after[:, None], left @ along, 0.0) - left @ (share.T @ along)
    blocks = len(sums)
    covariance = sums.T @ sums * blocks / max(blocks - 1 - len(size), 1) / np.outer(size, size)
    # no surer than white rows
    covariance += np.diag(np.maximum(1.0 / size - np.diag(covariance), 0.0))
    whole = np.zeros((both.recordings, len(size)))
    np.add.at(whole, both.recording, sums / size)
    freedom = max(both.recordings - 2, 1)
    scatter = float(np.mean(np.sum(whole**2, axis=0) * both.recordings / freedom / np.diag(covariance)))
    gains = coefficients**2 * size
    shown = np.sum((both.grams @ along) * along, axis=1)
    return _Raw(along, coefficients, covariance, scatter, float(gains.sum()), _effective(shown, both.after, gains))


def _effective(shown: Array, after: NDArray[np.bool_], gains: Array) -> float:
    """Degrees of freedom of Welch and Satterthwaite by the information (b, k) of blocks, a mean by ``gains`` (k,).

    Of a side, n = (sum u)^2 / sum u^2 blocks count, and its variance is 1 / sum u.
    """
    sides = [shown[after], shown[~after]]
    variance = [1.0 / np.maximum(u.sum(axis=0), 1e-300) for u in sides]
    count = [np.sum(u, axis=0) ** 2 / np.maximum(np.sum(u**2, axis=0), 1e-300) for u in sides]
    largest = np.maximum(*variance)
    shares = [one / largest for one in variance]
    freedom = (shares[0] + shares[1]) ** 2 / sum(one**2 / np.maximum(n, 1.0) for one, n in zip(shares, count))
    return float(freedom @ gains / max(float(gains.sum()), 1e-300))


def _judged(both: Both, every: Sequence[Hypothesis], raw: Sequence[_Raw | None]) -> list[Tested]:
    pairs = [(one, of) for one, of in zip(every, raw) if of is not None]
    # of one recording on each side, nothing says how far the next would differ
    scatter = np.array([of.scatter if both.recordings > 2 else 0.0 for _, of in pairs])
    freedom = np.full(len(pairs), float(max(both.recordings - 2, 1)))
    for what in {one.what for one, _ in pairs}:
        mine = np.array([one.what == what for one, _ in pairs])
        scatter[mine], freedom[mine] = moderate(scatter[mine], freedom[mine])
    found = []
    for (one, of), more, degrees in zip(pairs, scatter, freedom):
        covariance, count = of.covariance * max(more, 1.0), len(of.coefficients)
        square = float(of.coefficients @ np.linalg.pinv(covariance, hermitian=True) @ of.coefficients)
        left = min(of.freedom, degrees) if more > 1.0 else of.freedom
        left = max(left - count + 1, 1.0)
        log_p = float(stats.f.logsf(square / count, count, left))
        along = of.directions * both.scale[:, None]
        found.append(Tested(one, along, of.coefficients, covariance, of.gain, log_p))
    return found
