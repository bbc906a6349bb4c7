"""Robust maximum a posteriori estimation of a chain's values from tracked points, with the exact Jacobian.

Minimised is  sum_i rho(|p_i - f(q_i, x)| / s) + sum_k ((x_k - x0_k) / scale_k)^2  by Levenberg-Marquardt: the first sum
over points, with noise s estimated along the way, the second the priors, which decide only what the points cannot. Of
priors that are correlated the second is |u|^2, x - x0 = scale R u (``Parameters.prior_root``).

Every point counts if all of them agree with ordinary least squares. Otherwise points count with Geman and McClure's
weight (Stat. 1985) while the estimate is still moving, so that beam breaks and wrong points pull little; at the end
they are dropped altogether and the rest counts fully, so that the result and its covariance are those of ordinary least
squares on the good points. Whether a point agrees is judged by its predicted deviation: few points that fitted
themselves prove nothing against the others (``_distances``).

Joint extensions (sag, scale ...) enter as deflections of the joint angle, linear in their parameters: q + D(q) c.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.observed import linear_in, residual_of
from identification.kinematics.models.chain import Mask
from identification.kinematics.models.parameters import Parameters
from identification.selection import MEDIAN_OF_NORM

REJECT = 5.0
"""Points further off than this many deviations are outliers.

1.5e-5 of Gaussian points in three dimensions are.
"""
_CLEARER = 3.0
"""Noise of all points over that of a selection, above which the selection is believed."""
_OVERDETERMINED = 1.5
"""Coordinates per estimated parameter that a selection of points must have."""
_PLENTY = 50.0
"""Coordinates per unknown above which a point hardly pulls its own prediction."""
_STEPS = 60
"""Steps of a descent at most; it ends by its decrement (``_descend``)."""
_COARSE = 1500
"""Points with which the estimate is brought near; all of them then settle it."""
_LEAST_SHARE = 0.02
"""Least share of the noise's variance in a residual: a point that determines a parameter alone has none at all."""
LEAST_NOISE = 1e-6
"""m, less than the noise of any tracker: the scale of simulated points without noise. No smaller error counts."""


@dataclass(frozen=True)
class Fit:
    """Estimate of the free values and extension parameters.

    values      (values,) of the whole chain; rad, m
    extension   (extensions,) in the units of their deflections
    covariance  (free + extensions, same), in those units
    noise       m, standard deviation of one coordinate of one point, at least the stated one (``Points.std``)
    inlier      (N,) bool: points that were used in the end
    effective   effective number of parameters: how many directions the data decided rather than the prior
    """

    values: Array
    extension: Array
    covariance: Array
    noise: float
    inlier: Mask
    effective: float


def residuals(parameters: Parameters, values: Array, extension: Array, points: Points) -> Array:
    """Measured minus predicted (N, 3) m: ``observed.residual_of``."""
    return residual_of(parameters.chain.at(values), points, extension)


def stacked(jacobian: Array) -> Array:
    """(3 N, k) of (N, 3, k), also where nothing is free."""
    return jacobian.reshape(3 * len(jacobian), jacobian.shape[2])


def fit(
    parameters: Parameters,
    points: Points,
    *,
    start: Array | None = None,
    extension_scale: Array | None = None,
    extension_start: Array | None = None,
) -> Fit:
    """The robust estimate from ``points``, beginning at the chain's values or at ``start`` (values,).

    extension_scale (extensions,) are the prior deviations of the extension parameters, about zero; extension_start
    (extensions,): where they begin, zero by default.
    """
    problem, coarse, start_x = _begun(parameters, points, start, extension_scale, extension_start)
    x = _descend(coarse, start_x, _soft_weight, _STEPS, enough=0.1)
    length = np.linalg.norm(problem.residual(x), axis=1)
    x, inlier = _rejected(problem, x, length <= REJECT * problem.scale_of(length))
    robust = _result(problem, x, inlier)
    if inlier.all():
        return robust
    whole = _with_every_point(problem, coarse, start_x, _STEPS)
    x = np.concatenate((whole.values[parameters.free], whole.extension))
    if not (_distances(problem, x, whole.inlier) <= REJECT).all():
        return robust
    selective = 3 * inlier.sum() >= _OVERDETERMINED * robust.effective and inlier.mean() > 0.5
    return robust if selective and whole.noise > _CLEARER * robust.noise else whole


def fit_every_point(
    parameters: Parameters,
    points: Points,
    *,
    start: Array | None = None,
    extension_scale: Array | None = None,
    iterations: int = _STEPS,
) -> Fit:
    """The estimate by ordinary least squares, in which every point counts; arguments as of ``fit``.

    iterations: at most so many steps, where a rough estimate is enough.
    """
    problem, coarse, x = _begun(parameters, points, start, extension_scale)
    return _with_every_point(problem, coarse, x, iterations)


def _begun(
    parameters: Parameters,
    points: Points,
    start: Array | None,
    extension_scale: Array | None,
    extension_start: Array | None = None,
) -> tuple[_Problem, _Problem, Array]:
    """The problem of all points, that of ``_COARSE`` of them, and the unknowns (unknowns,) to begin at."""
    scale_x = np.zeros(0) if extension_scale is None else np.asarray(extension_scale, float)
    scale = np.concatenate((parameters.scale[parameters.free], scale_x))
    prior = np.concatenate((parameters.chain.values[parameters.free], np.zeros(len(scale_x))))
    x = prior.copy()
    if start is not None:
        x[: len(parameters.free)] = np.asarray(start, float)[parameters.free]
    if extension_start is not None:
        x[len(parameters.free) :] = extension_start
    problem = _Problem(parameters, points, prior, scale)
    fewer = points.where(slice(None, None, max(1, len(points) // _COARSE)))
    coarse = _Problem(parameters, fewer, prior, scale)
    return problem, coarse, problem.admitted(x) if parameters.held is not None else x


def _with_every_point(problem: _Problem, coarse: _Problem, x: Array, limit: int) -> Fit:
    """Ordinary least squares, from x (unknowns,), by way of fewer points."""
    x = _descend(coarse, x, _every_point, limit)
    if len(coarse.points) < len(problem.points):
        x = _descend(problem, x, _every_point, 20)
    return _result(problem, x, np.ones(len(problem.points), bool))


def _rejected(problem: _Problem, x: Array, inlier: Mask) -> tuple[Array, Mask]:
    """Estimate (unknowns,) and points (N,) kept: reject and refit until the same points are kept."""
    for _ in range(10):
        x = _descend(problem, x, _only(inlier), 20)
        kept = _distances(problem, x, inlier) <= REJECT
        if np.array_equal(kept, inlier):
            break
        inlier = kept
    return x, inlier


def _distances(problem: _Problem, x: Array, inlier: Mask) -> Array:
    """(N,) distance of every point from its prediction, in deviations of that distance.

    The residual of a point that took part in the fit has the covariance s^2 I - J C J', that of another one s^2 I + J C
    J' (Cook and Weisberg, "Residuals and Influence in Regression", 1982, 2.2), with C the covariance of the estimate
    and s from the median distance.
    """
    residual, jacobian = problem.linear(x)
    length = np.linalg.norm(residual, axis=1)
    good = stacked(jacobian[inlier])
    if 3 * inlier.sum() > _PLENTY * len(x):
        return np.asarray(length / problem.scale_of(length), float)
    gram, noise = good.T @ good, problem.scale_of(length)
    scaled = length
    for _ in range(5):
        hat = jacobian @ np.linalg.solve(gram + noise**2 * np.eye(len(gram)), np.swapaxes(jacobian, 1, 2))
        spread = np.eye(3) + np.where(inlier[:, None, None], -1.0, 1.0) * hat
        strength, axes = np.linalg.eigh(spread)
        along = np.einsum("nij,ni->nj", axes, residual)
        scaled = np.sqrt(np.sum(along**2 / np.maximum(strength, _LEAST_SHARE), axis=1))
        noise = problem.scale_of(scaled)
    return np.asarray(scaled / noise, float)


class _Problem:
    """Residuals and normal equations in unit-prior coordinates u, x = prior + root u."""

    def __init__(self, parameters: Parameters, points: Points, prior: Array, scale: Array) -> None:
        self.parameters, self.points, self.prior, self.scale = parameters, points, prior, scale
        self.joint_steps = parameters.chain.joint_steps()
        self.n_free = len(parameters.free)
        self.least = max(points.std, LEAST_NOISE)
        oriented = points.oriented
        self.kinds = [kind for kind in (~oriented, oriented) if kind.any()]
        root = parameters.prior_root(len(scale) - self.n_free)
        self.root, self._inverse = scale[:, None] * root, np.linalg.pinv(root) / scale

    def scale_of(self, length: Array) -> float:
        """m, the noise of a coordinate as residuals of ``length`` (N,) m show it, at least what is stated.

        That of positions or of orientations, whichever is larger: where orientations are weighed wrongly, the others
        would all be outliers by the median of both.
        """
        medians = [float(np.median(length[kind])) for kind in self.kinds]
        return max(max(medians) / MEDIAN_OF_NORM, self.least)

    def unit(self, x: Array) -> Array:
        """(r,) u."""
        return np.asarray(self._inverse @ (x - self.prior))

    def admitted(self, x: Array) -> Array:
        """(unknowns,) x without what the prior holds."""
        return np.asarray(self.prior + self.root @ self.unit(x))

    def values(self, x: Array) -> Array:
        """(v,) values of the chain at the unknowns x."""
        values = self.parameters.chain.values
        values[self.parameters.free] = x[: self.n_free]
        return values

    def residual(self, x: Array) -> Array:
        """(N, 3) m: measured minus predicted points."""
        return residuals(self.parameters, self.values(x), x[self.n_free :], self.points)

    def linear(self, x: Array) -> tuple[Array, Array]:
        """Residuals (N, 3) and the Jacobian of the prediction (N, 3, unknowns), per prior deviation."""
        chain = self.parameters.chain.at(self.values(x))
        residual, every = linear_in(chain, self.points, x[self.n_free :])
        jacobian = every[:, :, self.parameters.free]
        if self.points.deflections is not None and len(x) > self.n_free:
            jacobian = np.concatenate((jacobian, every[:, :, self.joint_steps] @ self.points.deflections), axis=2)
        return residual, jacobian @ self.root

    def cost(self, x: Array, weight: Array, noise: float, length: Array) -> float:
        """Negative logarithm of the posterior, twice: residuals of ``length`` (N,) m over the noise, and the prior."""
        return float(np.sum(weight * length**2) / noise**2 + np.sum(self.unit(x) ** 2))


Weight = Callable[[Array, float], Array]


def _soft_weight(length: Array, noise: float) -> Array:
    return 1.0 / (1.0 + (length / (3.0 * noise)) ** 2) ** 2


def _every_point(length: Array, noise: float) -> Array:
    return np.ones_like(length)


def _only(kept: Mask) -> Weight:
    return lambda length, noise: kept.astype(float)


def _descend(problem: _Problem, x: Array, weight_of: Weight, limit: int, *, enough: float = 1e-6) -> Array:
    """Levenberg-Marquardt from x (unknowns,), in at most ``limit`` iterations.

    It ends where Newton's decrement, twice the fall of the cost still to be had, in squared deviations, is below
    ``enough``.
    """
    damping = 1e-6
    for _ in range(limit):
        residual, jacobian = problem.linear(x)
        length = np.linalg.norm(residual, axis=1)
        noise = problem.scale_of(length)
        weight = weight_of(length, noise)
        flat = stacked(jacobian)
        root = np.repeat(np.sqrt(weight) / noise, 3)
        weighted = flat * root[:, None]
        hessian = weighted.T @ weighted + np.eye(flat.shape[1])
        gradient = weighted.T @ (root * residual.ravel()) - problem.unit(x)
        cost = problem.cost(x, weight, noise, length)
        for _ in range(12):
            step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient)
            trial = x + problem.root @ step
            reach = np.linalg.norm(problem.residual(trial), axis=1)
            # judged with this iteration's weights: robust weighting by majorisation
            if problem.cost(trial, weight, noise, reach) <= cost * (1 + 1e-12):
                break
            damping = max(damping * 10.0, 1e-6)
        else:
            return x
        damping = max(damping / 10.0, 1e-12)
        x = trial
        if gradient @ step < enough:
            return x
    return x


def _result(problem: _Problem, x: Array, inlier: Mask) -> Fit:
    """The estimate at x (unknowns,), from the points that ``inlier`` (N,) keeps."""
    residual, jacobian = problem.linear(x)
    good = stacked(jacobian[inlier])
    information = good.T @ good
    squares = float(np.sum(residual[inlier] ** 2))
    noise = max(np.sqrt(squares / max(3 * inlier.sum(), 1)), problem.least)
    effective = 0.0
    # In the eigenvectors of the information, the prior (unity) and the points add up direction by direction.
    strength, directions = np.linalg.eigh(information)
    strength = np.maximum(strength, 0.0)
    for _ in range(5):  # the effective number of parameters depends on the noise, weakly
        effective = float(np.sum(strength / (strength + noise**2)))
        noise = max(np.sqrt(squares / max(3 * inlier.sum() - effective, 1.0)), problem.least)
    unit = (directions * (noise**2 / (strength + noise**2))) @ directions.T
    covariance = problem.root @ unit @ problem.root.T
    n = problem.n_free
    return Fit(problem.values(x), x[n:], covariance, noise, inlier, effective)
