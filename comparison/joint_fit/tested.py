"""What hypotheses explain of how two sides differ, each given changes that are known.

With D the directions of a hypothesis, F those by which friction differs between the sides of any arm, each by one
standard deviation (``friction_drift``), M the information of both sides and s the scores of the side after
(``joint_regression``), its coefficients c are estimated by generalised least squares, F u being noise of variance 1:

    E^T M D c = E^T s,    E = D - F (K + F^T M F)^-1 F^T M D

so that a hypothesis is judged by what the drift of friction leaves of it: another scale of currents by masses more than
by friction. K is how many times the noise of the rows, which is coloured, exceeds that of white rows, in each F. The
covariance of c is that of sums over blocks of time, times what the sums over whole recordings scatter beyond it, and
what F does to c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from arm_io.types import Array
from comparison.joint_fit.hypotheses import Hypothesis
from comparison.joint_fit.joint_regression import RANK_TOLERANCE, JointRegression
from comparison.significance import moderate


@dataclass(frozen=True)
class Tested:
    """A hypothesis as tested.

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
class _Conditional:
    """The shared fit given the changes that are known, which it has.

    residual  (n,) of the rows
    scores    (c,) of the side after
    m         (c, c) M
    known, apart  (c, k) their directions, and (k, c) the coefficients that they have in what M makes of a direction
    drift     (c, c) F (K + F^T M F)^-1 F^T: the drift of friction that scores (c,) show, as changes of the values
    estimated  by hypothesis; None where the sides do not show it
    """

    residual: Array
    scores: Array
    m: Array
    known: Array
    apart: Array
    drift: Array
    estimated: dict[Hypothesis, _Estimate | None]

    def of(self, directions: Array) -> Array:
        """Directions (c, k) with what the known changes do meanwhile."""
        return np.asarray(directions - self.known @ (self.apart @ (self.m @ directions)))


@dataclass(frozen=True)
class _Shape:
    """Independent combinations of a hypothesis that the sides show, scaled; there may be none.

    directions, changed, along  (c, k): D; with what the known changes do meanwhile; E
    size, coefficients  (k,) of E^T M D, which is diagonal, and c
    """

    directions: Array
    changed: Array
    along: Array
    size: Array
    coefficients: Array


@dataclass(frozen=True)
class _Estimate:
    """What the blocks of time say of a shape: covariance (k, k) of its coefficients; scatter of recordings over it.

    drift    (k, d) change of the coefficients by one standard deviation each of what differs where nothing changed
    freedom  degrees of freedom by the blocks of both sides that show the coefficients
    """

    shape: _Shape
    covariance: Array
    drift: Array
    scatter: float
    gain: float
    freedom: float


def residuals_of(fit: JointRegression, found: Sequence[Tested]) -> list[Array]:
    """(k,) per recording: what the shared fit with the changes ``found`` leaves of its rows, over their noise."""
    residual = _remaining(fit, fit.residual, _changes(fit, found))
    return [residual[fit.recording[fit.block] == k] for k in range(fit.recordings)]


def _remaining(fit: JointRegression, residual: Array, changes: Array) -> Array:
    """(n,) what changes (c,) of the side after leave of a residual (n,) of the shared fit."""
    sides = fit.beside_shared(changes)
    return residual - np.concatenate([piece.of(sides) for piece in fit.pieces])


def _changes(fit: JointRegression, found: Sequence[Tested]) -> Array:
    """(c,) scaled: the changes ``found``."""
    return np.asarray(sum((one.changes for one in found), np.zeros(len(fit.scale))) / fit.scale)


def shared_values(fit: JointRegression, model: Array, found: Sequence[Tested]) -> tuple[Array, Array]:
    """(c,) values of the side before, with the changes ``found``, and their covariance (c, c), of white rows.

    model: (c,) values of the model.
    """
    values = fit.information[0] @ (fit.moment - fit.total_after @ _changes(fit, found))
    return model + fit.scale * values, fit.information[0] * fit.scale[:, None] * fit.scale


def tested(fit: JointRegression, every: Sequence[Hypothesis], chosen: Sequence[Hypothesis]) -> list[Tested]:
    """Each hypothesis of ``every``, tested conditional on those ``chosen``.

    What is estimated of one is kept for the next test of this fit.
    """
    key = frozenset(chosen)
    if key not in fit.known:
        fit.known[key] = _conditional(fit, chosen)
    given: _Conditional = fit.known[key]
    new = [one for one in every if one not in given.estimated]
    shapes = [_shape(given, one.directions / fit.scale[:, None]) for one in new]
    given.estimated.update(zip(new, _estimates(fit, given, shapes)))
    return _with_scatter(fit, every, [given.estimated[one] for one in every])


def tested_alone(
    fit: JointRegression, one: Hypothesis, every: Sequence[Hypothesis], chosen: Sequence[Hypothesis]
) -> list[Tested]:
    """What ``tested`` says of ``one``; nothing where the sides do not show it.

    Of the others of ``every`` only those of its kind matter: how they scatter between recordings is pooled.
    """
    pooled = [
        each
        for each in every
        if each is one or (_scatters(fit) and each.what == one.what and all(each is not other for other in chosen))
    ]
    return [each for each in tested(fit, pooled, chosen) if each.hypothesis is one]


def _scatters(fit: JointRegression) -> bool:
    """Whether recordings show how far the next would differ: one on each side does not."""
    return fit.recordings > 2


def _conditional(fit: JointRegression, chosen: Sequence[Hypothesis]) -> _Conditional:
    m = fit.information[2]
    added = np.concatenate([np.empty((len(m), 0)), *(one.directions for one in chosen)], axis=1) / fit.scale[:, None]
    apart = (
        np.linalg.pinv(added.T @ m @ added, hermitian=True, rcond=RANK_TOLERANCE) @ added.T
        if added.shape[1]
        else added.T
    )
    fitted = added @ (apart @ fit.scores)
    residual, scores = _remaining(fit, fit.residual, fitted), fit.scores - m @ fitted
    given = _Conditional(residual, scores, m, added, apart, np.zeros_like(m), {})
    return replace(given, drift=_drift(fit, given))


def _drift(fit: JointRegression, given: _Conditional) -> Array:
    """(c, c) the drift of friction; ``given``: as if there were none."""
    m = given.m
    columns = [_shape(given, one[:, None]) for one in fit.drift.T]
    noise = [
        float(one.shape.size[0] * one.covariance[0, 0] * max(one.scatter if _scatters(fit) else 1.0, 1.0))
        for one in _estimates(fit, given, columns)
        if one is not None
    ]
    if not noise:
        return given.drift
    drift = given.of(fit.drift[:, [len(one.size) > 0 for one in columns]])
    return np.asarray(drift @ np.linalg.solve(np.diag(noise) + drift.T @ m @ drift, drift.T))


def _shape(given: _Conditional, directions: Array) -> _Shape:
    """Of directions (c, k), scaled."""
    changed = given.of(directions)
    size, axes = np.linalg.eigh(changed.T @ given.m @ changed)
    axes = axes[:, size > RANK_TOLERANCE * max(float(np.sum(changed**2)), 1e-300) / len(size)]
    along = changed @ axes - given.drift @ (given.m @ (changed @ axes))
    size, turn = np.linalg.eigh(axes.T @ changed.T @ given.m @ along)
    axes, along = axes @ turn, along @ turn
    return _Shape(directions @ axes, changed @ axes, along, size, along.T @ given.scores / size)


def _estimates(fit: JointRegression, given: _Conditional, shapes: Sequence[_Shape]) -> list[_Estimate | None]:
    """Of each shape, by what the shared fit leaves; None where the sides do not show it."""
    if not shapes:
        return []
    sizes = [len(one.size) for one in shapes]
    along = np.concatenate([one.along for one in shapes], axis=1)
    changed = np.stack([one.changed @ one.coefficients for one in shapes], axis=1)
    # with the drift that is seen beside the change, which is no noise of the rows
    changed = changed + given.drift @ (given.scores[:, None] - given.m @ changed)
    sums, informed = _of_blocks(fit, given, along, changed, np.repeat(np.arange(len(shapes)), sizes))
    drifting = given.m @ fit.drift
    estimates: list[_Estimate | None] = []
    end = 0
    for one, count in zip(shapes, sizes):
        columns = slice(end, end := end + count)
        white = np.sum(one.along * (given.m @ one.along), axis=0) / one.size**2
        moved = one.along.T @ drifting / one.size[:, None]
        parts = sums[:, columns], informed[:, columns]
        estimates.append(_estimate(fit, one, *parts, white, moved) if count else None)
    return estimates


def _of_blocks(
    fit: JointRegression, given: _Conditional, along: Array, changed: Array, of: NDArray[np.intp]
) -> tuple[Array, Array]:
    """(b, k) of each block of time: scores and information of directions ``along`` (c, k) of hypotheses ``of`` (k,).

    Scores are at the fits in which the hypotheses have ``changed`` (c, h).
    """
    beside, moved = fit.beside_shared(along), fit.beside_shared(changed)
    sums, informed = np.zeros((2, len(fit.recording), len(of)))
    for piece in fit.pieces:
        remaining = given.residual[piece.rows, None] - piece.of(moved)
        sums[piece.blocks] += piece.sums @ (remaining[:, of] * piece.of(beside))
        informed[piece.blocks] += piece.sums @ piece.of((along, along)) ** 2
    return sums, informed


def _estimate(fit: JointRegression, one: _Shape, sums: Array, shown: Array, white: Array, drift: Array) -> _Estimate:
    """``sums`` (b, k) of blocks at the fit with the change, information (b, k) of each, variance (k,) of white rows."""
    size, blocks = one.size, len(sums)
    covariance = sums.T @ sums * blocks / max(blocks - 1 - len(size), 1) / np.outer(size, size)
    # no surer than white rows
    covariance += np.diag(np.maximum(white - np.diag(covariance), 0.0))
    whole = np.zeros((fit.recordings, len(size)))
    np.add.at(whole, fit.recording, sums / size)
    spare = max(fit.recordings - 2, 1)
    scatter = float(np.mean(np.sum(whole**2, axis=0) * fit.recordings / spare / np.diag(covariance)))
    gains = one.coefficients**2 * size
    freedom = _effective(shown, fit.after, gains)
    return _Estimate(one, covariance, drift, scatter, float(gains.sum()), freedom)


def _effective(shown: Array, after: NDArray[np.bool_], gains: Array) -> float:
    """Degrees of freedom (Welch, Satterthwaite) by the information (b, k) of blocks; mean weighted by ``gains`` (k,).

    A side counts as n = (sum u)^2 / sum u^2 blocks, with variance 1 / sum u.
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
    scatter = np.array([of.scatter if _scatters(fit) else 0.0 for _, of in pairs])
    freedom = np.full(len(pairs), float(max(fit.recordings - 2, 1)))
    for subject in {one.what for one, _ in pairs}:
        alike = np.array([one.what == subject for one, _ in pairs])
        scatter[alike], freedom[alike] = moderate(scatter[alike], freedom[alike])
    covariances, squares, counts, denominators = [], [], [], []
    for (_, of), more, degrees in zip(pairs, scatter, freedom):
        estimated, count = of.covariance * max(more, 1.0), len(of.shape.coefficients)
        covariance = estimated + of.drift @ of.drift.T
        along = np.linalg.pinv(covariance, hermitian=True) @ of.shape.coefficients
        square = float(of.shape.coefficients @ along)
        # of Satterthwaite: the variance that drift adds is known
        known = square / max(float(along @ estimated @ along), 1e-300)
        denominator = (min(of.freedom, degrees) if more > 1.0 else of.freedom) * known**2
        covariances.append(covariance)
        squares.append(square)
        counts.append(count)
        denominators.append(max(denominator - count + 1, 1.0))
    log_p = np.asarray(stats.f.logsf(np.divide(squares, counts), counts, denominators))
    return [
        Tested(one, of.shape.directions * fit.scale[:, None], of.shape.coefficients, covariance, of.gain, float(p))
        for (one, of), covariance, p in zip(pairs, covariances, log_p)
    ]
