"""How good a calibration is on points, and which extensions earn their place: judged on points that the fit has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.extensions import Extension, prior_scales
from identification.kinematics.estimation.map_estimation import REJECT, Fit, fit
from identification.kinematics.models.chain import Index, position_jacobian
from identification.kinematics.models.parameters import Parameters


@dataclass(frozen=True)
class PositionError:
    """Error of predicted positions over points.

    rms      m, a coordinate: sqrt(mean(r^2)) over all coordinates, so that a perfect model shows the tracker's own noise
    mean, largest  m, distance in space
    outliers number of points left out: further off than 5 robust deviations
    """

    rms: float
    mean: float
    largest: float
    points: int
    outliers: int


def position_error(residual: Array, *, reject: bool = True) -> PositionError:
    """The error of residuals (N, 3) m; beam breaks and wrong points, detected by their robust scale, are left out and counted."""
    length = np.linalg.norm(residual, axis=1)
    keep = np.ones(len(length), bool)
    if reject and len(length):
        keep = length <= max(REJECT * float(np.median(length)) / 1.5382, 1e-8)
    good = length[keep]
    if not len(good):
        return PositionError(float("nan"), float("nan"), float("nan"), 0, int((~keep).sum()))
    return PositionError(
        float(np.sqrt(np.mean(good**2) / 3.0)), float(good.mean()), float(good.max()), len(good), int((~keep).sum())
    )


@dataclass(frozen=True)
class Trial:
    """One extension tried on top of those accepted so far: mean square error on unseen points before and after."""

    extension: Extension
    before: float  # m, rms
    after: float
    z: float  # gain over its standard error between blocks
    accepted: bool


def choose(
    parameters: Parameters,
    points: Points,
    blocks: Index,
    candidates: Sequence[Extension],
    deflect: Callable[[Sequence[Extension]], Array],
    start: Fit,
    *,
    folds: int = 5,
    report: Callable[[str], None] | None = None,
) -> tuple[list[Extension], list[Trial]]:
    """Extensions accepted one after the other, the best first.

    Points are cut into blocks (N,) of neighbours; whole blocks are left out in turn, so that no point is predicted from its own
    neighbours. A candidate is accepted if its gain on left-out blocks exceeds three standard errors (between blocks) and 2 % of the
    rms: less is not worth a parameter. All of it on the linearised problem, which after the fit is exact to a micrometre.

    deflect gives the deflections (N, joints, parameters) of extensions at ``points``.
    """
    thin = np.flatnonzero(start.inlier)
    thin = thin[:: max(1, len(thin) // 6000)]
    part, blocks = points.where(thin), blocks[thin]
    fold = _folds(blocks, folds)
    chosen: list[Extension] = []
    trials: list[Trial] = []
    remaining = list(candidates)
    while remaining:
        bend = deflect(chosen)[thin] if chosen else None
        now = fit(parameters, Points(part.q, part.xyz, bend), start=start.values, extension_scale=prior_scales(chosen))
        linear = _linear(parameters, part, bend, now)
        normals = _normals(linear, fold)
        before = _left_out(linear, normals, np.zeros((len(part), 3, 0)), np.zeros(0))
        best: tuple[Trial, Extension] | None = None
        for extension in remaining:
            columns = linear.joint @ deflect([extension])[thin]
            after = _left_out(linear, normals, columns, np.array(extension.scales))
            trial = _judge(extension, before, after, blocks)
            if best is None or trial.after < best[0].after:
                best = (trial, extension)
        if best is None:
            break
        trials.append(best[0])
        if report is not None:
            report(f"{best[1]}: {1e3 * best[0].before:.4f} -> {1e3 * best[0].after:.4f} mm on unseen points")
        if not best[0].accepted:
            break
        chosen.append(best[1])
        remaining.remove(best[1])
    return chosen, trials


@dataclass(frozen=True)
class _Linear:
    """About an estimate: residual (N, 3), columns per prior deviation (N, 3, p), where u0 (p,) stands, dp/dq (N, 3, joints)."""

    residual: Array
    columns: Array
    at: Array
    joint: Array
    noise: float


def _linear(parameters: Parameters, points: Points, bend: Array | None, estimate: Fit) -> _Linear:
    bent = Points(points.q, points.xyz, bend).bent(estimate.extension)
    chain = parameters.chain.at(estimate.values)
    at, every = position_jacobian(chain, bent)
    joint = every[:, :, chain.joint_steps()]
    free, scale = parameters.free, parameters.scale[parameters.free]
    columns = every[:, :, free] * scale
    where = (estimate.values - parameters.chain.values)[free] / scale
    if bend is not None and len(estimate.extension):
        deviation = np.sqrt(np.diag(estimate.covariance))[len(free) :]
        spread = np.maximum(10.0 * deviation, np.abs(estimate.extension))  # free to move: it is already found
        columns = np.concatenate((columns, (joint @ bend) * spread), axis=2)
        where = np.concatenate((where, np.zeros(len(spread))))
    return _Linear(points.xyz - at, columns, where, joint, estimate.noise)


@dataclass(frozen=True)
class _Normal:
    """Normal equations of one fold: the points in it, and H = A'A, g = A'r in units of the noise."""

    rows: Index
    flat: Array
    residual: Array
    hessian: Array
    gradient: Array


def _normals(linear: _Linear, fold: Index) -> list[_Normal]:
    out = []
    for k in np.unique(fold):
        rows = np.flatnonzero(fold == k)
        flat = linear.columns[rows].reshape(-1, linear.columns.shape[2]) / linear.noise
        residual = linear.residual[rows].ravel() / linear.noise
        out.append(_Normal(rows, flat, residual, flat.T @ flat, flat.T @ residual))
    return out


def _left_out(linear: _Linear, folds: Sequence[_Normal], extra: Array, scales: Array) -> Array:
    """Squared residual length (N,) of every point, each predicted without its fold: one linear solution a fold.

    extra (N, 3, k) are columns of an extension on top; the blocks of the normal equations without them are given.
    """
    added = [(extra[f.rows] * (scales / linear.noise)).reshape(3 * len(f.rows), len(scales)) for f in folds]
    hessians = [
        np.block([[f.hessian, f.flat.T @ e], [e.T @ f.flat, e.T @ e]]) for f, e in zip(folds, added, strict=True)
    ]
    gradients = [np.concatenate((f.gradient, e.T @ f.residual)) for f, e in zip(folds, added, strict=True)]
    prior = np.concatenate((linear.at, np.zeros(len(scales))))
    hessian, gradient = sum(hessians) + np.eye(len(prior)), sum(gradients) - prior
    squares = np.empty(len(linear.residual))
    for f, e, h, g in zip(folds, added, hessians, gradients, strict=True):
        step = np.linalg.solve(hessian - h, gradient - g)
        left = (f.residual - f.flat @ step[: len(linear.at)] - e @ step[len(linear.at) :]) * linear.noise
        squares[f.rows] = np.sum(left.reshape(-1, 3) ** 2, axis=1)
    return squares


def _folds(blocks: Index, folds: int) -> Index:
    names, index = np.unique(blocks, return_inverse=True)
    order = np.random.default_rng(1).permutation(len(names))
    return (order % min(folds, max(2, len(names))))[index]


def _judge(extension: Extension, before: Array, after: Array, blocks: Index) -> Trial:
    _, index = np.unique(blocks, return_inverse=True)
    gain = np.bincount(index, before - after)
    error = float(np.sqrt(np.sum((gain - gain.mean()) ** 2) * len(gain) / max(len(gain) - 1, 1)))
    z = float(gain.sum() / max(error, 1e-300))
    rms_before, rms_after = (float(np.sqrt(np.mean(s) / 3.0)) for s in (before, after))
    return Trial(extension, rms_before, rms_after, z, bool(z > 3.0 and rms_after < 0.98 * rms_before))
