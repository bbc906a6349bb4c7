"""The recordings of two sides in one regression: what one hypothesis explains, if nothing else changed.

A regression per recording asks for every value at once, and a change of one is lost in what all others may have done
meanwhile. Here all recordings share one set of values, and one hypothesis at a time may differ between the sides. With
G the normal matrices of the sides and e the residual of the shared fit, its coefficients c follow from

    D^T M D c = D^T s,    M = G_after - G_after (G_before + G_after)^-1 G_after,    s = sum of x e over the rows after

(the parallel sum of both sides' information). Their covariance is that of sums over blocks of time, times what the sums
over whole recordings scatter beyond it; and what friction differs by between the sides of any arm (``friction_drift``)
moves them, as the change d of the values does: c = (D^T M D)^-1 D^T M d.

Another scale of a joint's currents is no change of the values: a mass beyond the joint loads other joints, too. It has
a column of its own, the torque of that joint by the values before, which the shared fit has not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse, stats

from arm_io.types import Array
from comparison.joint_fit.hypotheses import Hypothesis
from comparison.regression import Fitted, Rows, Structure
from comparison.significance import moderate

RANK_TOLERANCE = 1e-6
"""Of a column's own size: combinations of a hypothesis that the two sides show."""
LEAST_BLOCK = 0.1
"""s: shorter blocks of time cost more and say no more."""
NONE = 1e-9
"""Of a column's square: what keeps values determined that no recording shows."""


@dataclass(frozen=True)
class JointRegression:
    """Weighted rows of all recordings, for values in units of ``scale`` (c,).

    The last ``scales`` of the c values are changes of scale of the joints' currents, 0 before.

    x, y       (n, c) columns and (n,) torques less the model's, over the noise
    block      (n,) the block of time of each row; recording, after  (b,) of each block
    total, total_after  (c, c) normal matrices of all rows, and of the side after
    drift      (c, d) changes of the values by one standard deviation each of what differs where nothing changed
    """

    x: Array
    y: Array
    block: NDArray[np.intp]
    recording: NDArray[np.intp]
    after: NDArray[np.bool_]
    scale: Array
    total: Array
    total_after: Array
    drift: Array
    scales: int = 0

    @property
    def recordings(self) -> int:
        return int(self.recording.max()) + 1

    @property
    def rows_after(self) -> NDArray[np.bool_]:
        """(n,) rows of the side after."""
        return np.asarray(self.after[self.block])

    def information(self) -> tuple[Array, Array, Array]:
        """(c, c) each: pseudo-inverse of both sides' matrix, share of the shared fit that is of the side after, M."""
        common = len(self.total) - self.scales
        inverse = np.zeros_like(self.total)
        own = self.total[:common, :common]
        inverse[:common, :common] = np.linalg.pinv(own + NONE * np.eye(common), hermitian=True)
        share = self.total_after @ inverse
        return inverse, share, np.asarray(self.total_after - share @ self.total_after)


@dataclass(frozen=True)
class Tested:
    """What a hypothesis explains.

    directions, coefficients, covariance  (c, k), (k,) and (k, k): the combinations of it that both sides show, the last
             with what the drift does to them
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
class _Estimate:
    """Coefficients (k,) of independent directions (c, k), scaled; covariance (k, k) by blocks; scatter over it.

    drift    (k, d) change of the coefficients by one standard deviation each of what differs where nothing changed
    freedom  degrees of freedom by the blocks of both sides that show the coefficients
    """

    directions: Array
    coefficients: Array
    covariance: Array
    drift: Array
    scatter: float
    gain: float
    freedom: float


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
    square = np.array([_spread(rows, fitted, joints) for rows, fitted in zip(data, fits)])
    noise = np.sqrt(np.array([np.median(of[np.isfinite(of)]) if np.isfinite(of).any() else 1.0 for of in square.T]))
    parts = [_weighted(rows, model, noise) for rows in data]
    before = _values_of([one for one, mine in zip(parts, is_before) if mine], model)
    parts = [(np.concatenate([x, _scales(one, before, noise)], axis=1), y) for one, (x, y) in zip(data, parts)]
    square = sum((x**2).sum(axis=0) for x, _ in parts)
    # of a joint that stands, or a gap that its load never crosses, nothing is shown
    scale = 1.0 / _sizes(square)
    blocks: list[NDArray[np.intp]] = []
    recording: list[int] = []
    for number, (rows, one) in enumerate(zip(data, fits)):
        _, block = np.unique((rows.equations.t / max(one.block, LEAST_BLOCK)).astype(np.intp), return_inverse=True)
        blocks.append(block + len(recording))
        recording += [number] * (int(block.max()) + 1)
    of, block = np.array(recording, np.intp), np.concatenate(blocks)
    x, y = np.concatenate([one * scale for one, _ in parts]), np.concatenate([one for _, one in parts])
    rows_after = x[~is_before[of][block]]
    drift = np.pad(drift, ((0, size - structure.size), (0, 0))) / scale[:, None]
    squares = x.T @ x, rows_after.T @ rows_after
    return JointRegression(x, y, block, of, ~is_before[of], scale, *squares, drift, joints)


def _spread(rows: Rows, fitted: Fitted, joints: int) -> Array:
    """(J,) mean square residual of each joint's rows; NaN of a joint that stands."""
    of = [fitted.residual[rows.equations.joint == j] for j in range(joints)]
    return np.array([np.mean(mine**2) if len(mine) else np.nan for mine in of])


def _weighted(rows: Rows, model: Array, noise: Array) -> tuple[Array, Array]:
    """Columns and torques of a recording over the noise, without what its own columns explain."""
    stacked = _without_own(rows, np.column_stack([rows.columns, rows.y - rows.columns @ model]), noise)
    return stacked[:, :-1], stacked[:, -1]


def _without_own(rows: Rows, columns: Array, noise: Array) -> Array:
    """Columns (k, c) over the noise, without what the recording's own columns explain."""
    weight = 1.0 / np.maximum(noise[rows.equations.joint], 1e-300)[:, None]
    x = np.asarray(columns * weight)
    if rows.own.shape[1]:
        u, size, _ = np.linalg.svd(rows.own * weight, full_matrices=False)
        u = u[:, size > RANK_TOLERANCE * max(size[0], 1e-300)]
        x = x - u @ (u.T @ x)
    return x


def _values_of(parts: Sequence[tuple[Array, Array]], model: Array) -> Array:
    """(c,) values that some recordings show, as of ``_weighted``; those of the model where none does."""
    square, moment = sum(x.T @ x for x, _ in parts), sum(x.T @ y for x, y in parts)
    size = _sizes(np.diag(square))
    return np.asarray(
        model
        + np.linalg.pinv(square / np.outer(size, size), rcond=RANK_TOLERANCE, hermitian=True) @ (moment / size) / size
    )


def _sizes(square: Array) -> Array:
    """(c,) lengths of columns from their squares; 1 of one that shows nothing, whose value is rounding."""
    return np.sqrt(np.where(square > 0.0, square, 1.0))


def _scales(rows: Rows, values: Array, noise: Array) -> Array:
    """(k, J) torque of each joint alone by the values (c,), as ``_apart``."""
    own = rows.equations.joint[:, None] == np.arange(len(noise))
    return _without_own(rows, (rows.columns @ values)[:, None] * own, noise)


def residuals_of(fit: JointRegression, found: Sequence[Tested]) -> list[Array]:
    """(k,) per recording: residual of its rows in the joint fit with the changes ``found``, over their noise."""
    values, changes = _shared(fit, found)
    residual = fit.y - fit.x @ values - np.where(fit.rows_after, fit.x @ changes, 0.0)
    return [residual[fit.recording[fit.block] == k] for k in range(fit.recordings)]


def _shared(fit: JointRegression, found: Sequence[Tested]) -> tuple[Array, Array]:
    """(c,) scaled: the values of the side before, less the model's, and the changes ``found``."""
    changes = sum((one.changes for one in found), np.zeros(len(fit.scale))) / fit.scale
    return fit.information()[0] @ (fit.x.T @ fit.y - fit.total_after @ changes), changes


def shared_values(fit: JointRegression, model: Array, found: Sequence[Tested]) -> tuple[Array, Array]:
    """(c,) values of the side before, with the changes ``found``, and their covariance (c, c), of white rows.

    model: (c,) values of the model.
    """
    values, _ = _shared(fit, found)
    return model + fit.scale * values, fit.information()[0] * fit.scale[:, None] * fit.scale


def tested(fit: JointRegression, every: Sequence[Hypothesis], chosen: Sequence[Hypothesis]) -> list[Tested]:
    """What each of ``every`` explains, conditional on those ``chosen``."""
    inverse, share, m = fit.information()
    known = np.concatenate([np.empty((len(m), 0)), *(one.directions for one in chosen)], axis=1) / fit.scale[:, None]
    apart = (
        np.linalg.pinv(known.T @ m @ known, hermitian=True, rcond=RANK_TOLERANCE) @ known.T
        if known.shape[1]
        else known.T
    )
    after = fit.rows_after
    scores = fit.x[after].T @ fit.y[after]
    found = known @ (apart @ (scores - share @ (fit.x.T @ fit.y)))
    residual = fit.y - np.where(after, fit.x @ found, 0.0)
    residual = residual - fit.x @ (inverse @ (fit.x.T @ residual))
    scores = fit.x[after].T @ residual[after]
    shapes = []
    for one in every:
        directions = one.directions / fit.scale[:, None]
        shapes.append(_shape(scores, directions - known @ (apart @ (m @ directions)), m))
    return _with_scatter(fit, every, _estimates(fit, residual, shapes, inverse, share, m @ fit.drift))


def _shape(scores: Array, directions: Array, m: Array) -> tuple[Array, Array, Array]:
    """Independent directions (c, k) that the sides show, with size (k,) and coefficients (k,); k may be 0.

    scores: (c,) of the side after, at the shared fit.
    """
    size, axes = np.linalg.eigh(directions.T @ m @ directions)
    kept = size > RANK_TOLERANCE * max(float(np.sum(directions**2)), 1e-300) / len(size)
    along, size = directions @ axes[:, kept], size[kept]
    return along, size, along.T @ scores / size


def _estimates(
    fit: JointRegression,
    residual: Array,
    shapes: Sequence[tuple[Array, Array, Array]],
    inverse: Array,
    share: Array,
    drifting: Array,
) -> list[_Estimate | None]:
    """Of each hypothesis, from what the shared fit leaves (n,); None where the sides do not show it.

    drifting: (c, d) M times the drift.
    """
    after, blocks = fit.rows_after, len(fit.recording)
    along = np.concatenate([one for one, _, _ in shapes], axis=1)
    changed = np.stack([one @ coefficients for one, _, coefficients in shapes], axis=1)
    shown, shared = fit.x @ along, fit.x @ (share.T @ along)
    # the residual of the fit in which it has changed
    remaining = residual[:, None] - np.where(after[:, None], fit.x @ changed, 0.0)
    remaining += fit.x @ (inverse @ (fit.total_after @ changed))
    into = sparse.csr_array((np.ones(len(after)), (fit.block, np.arange(len(after)))), (blocks, len(after)))
    found: list[_Estimate | None] = []
    end = 0
    for k, (one, size, coefficients) in enumerate(shapes):
        own = slice(end, end := end + len(size))
        moves = np.where(after[:, None], shown[:, own], 0.0) - shared[:, own]
        parts = into @ (remaining[:, k, None] * moves), into @ (shown[:, own] ** 2)
        drift = one.T @ drifting / size[:, None]
        found.append(_estimate(fit, (one, size, coefficients), *parts, drift) if len(size) else None)
    return found


def _estimate(
    fit: JointRegression, shape: tuple[Array, Array, Array], sums: Array, shown: Array, drift: Array
) -> _Estimate:
    """``sums`` (b, k) of blocks at the fit with the change, and the information (b, k) of each."""
    along, size, coefficients = shape
    blocks = len(sums)
    covariance = sums.T @ sums * blocks / max(blocks - 1 - len(size), 1) / np.outer(size, size)
    # no surer than white rows
    covariance += np.diag(np.maximum(1.0 / size - np.diag(covariance), 0.0))
    whole = np.zeros((fit.recordings, len(size)))
    np.add.at(whole, fit.recording, sums / size)
    spare = max(fit.recordings - 2, 1)
    scatter = float(np.mean(np.sum(whole**2, axis=0) * fit.recordings / spare / np.diag(covariance)))
    gains = coefficients**2 * size
    freedom = _effective(shown, fit.after, gains)
    return _Estimate(along, coefficients, covariance, drift, scatter, float(gains.sum()), freedom)


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


def _with_scatter(fit: JointRegression, every: Sequence[Hypothesis], raw: Sequence[_Estimate | None]) -> list[Tested]:
    pairs = [(one, of) for one, of in zip(every, raw) if of is not None]
    # of one recording on each side, nothing says how far the next would differ
    scatter = np.array([of.scatter if fit.recordings > 2 else 0.0 for _, of in pairs])
    freedom = np.full(len(pairs), float(max(fit.recordings - 2, 1)))
    for what in {one.what for one, _ in pairs}:
        mine = np.array([one.what == what for one, _ in pairs])
        scatter[mine], freedom[mine] = moderate(scatter[mine], freedom[mine])
    found = []
    for (one, of), more, degrees in zip(pairs, scatter, freedom):
        covariance, count = of.covariance * max(more, 1.0) + of.drift @ of.drift.T, len(of.coefficients)
        square = float(of.coefficients @ np.linalg.pinv(covariance, hermitian=True) @ of.coefficients)
        denominator = min(of.freedom, degrees) if more > 1.0 else of.freedom
        denominator = max(denominator - count + 1, 1.0)
        log_p = float(stats.f.logsf(square / count, count, denominator))
        along = of.directions * fit.scale[:, None]
        found.append(Tested(one, along, of.coefficients, covariance, of.gain, log_p))
    return found
