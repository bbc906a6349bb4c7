"""How good a calibration is on points, and which extensions earn their place: judged on points that the fit has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from identification.kinematics.chain import Array
from identification.kinematics.extensions import Extension, prior_scales
from identification.kinematics.least_squares import REJECT, Fit, Points, fit, residuals
from identification.kinematics.parameters import Parameters


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
    """The error of residuals (N, 3) m; beam breaks and wrong points, told by their own robust scale, are left out and counted."""
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
    blocks: Array,
    candidates: Sequence[Extension],
    deflect: Callable[[Sequence[Extension]], Array],
    start: Fit,
    *,
    folds: int = 4,
    report: Callable[[str], None] | None = None,
) -> tuple[list[Extension], list[Trial]]:
    """Extensions accepted one after the other, the best first.

    Points are cut into blocks (N,) of neighbours; whole blocks are left out in turn, so that no point is predicted from its own
    neighbours. A candidate is accepted if its gain on left-out blocks exceeds three standard errors (between blocks) and 2 % of the
    rms: less is not worth a parameter.
    """
    good = start.inlier
    points, blocks = points.where(good), blocks[good]
    fold = _folds(blocks, folds)
    chosen: list[Extension] = []
    trials: list[Trial] = []
    before = _left_out(parameters, _with(points, chosen, deflect, good), fold, chosen, start)
    remaining = list(candidates)
    while remaining:
        best: tuple[Trial, Array] | None = None
        for extension in _promising(parameters, points, good, chosen, remaining, deflect, start):
            after = _left_out(parameters, _with(points, [*chosen, extension], deflect, good), fold, [*chosen, extension], start)
            trial = _judge(extension, before, after, blocks)
            if report is not None:
                report(f"tried {extension}: {1e3 * trial.before:.4f} -> {1e3 * trial.after:.4f} mm on unseen points")
            if best is None or trial.after < best[0].after:
                best = (trial, after)
        if best is None:
            break
        trials.append(best[0])
        if not best[0].accepted:
            break
        chosen.append(best[0].extension)
        remaining.remove(best[0].extension)
        before = best[1]
    return chosen, trials


def _promising(
    parameters: Parameters,
    points: Points,
    good: Array,
    chosen: list[Extension],
    remaining: list[Extension],
    deflect: Callable[[Sequence[Extension]], Array],
    start: Fit,
    most: int = 4,
) -> list[Extension]:
    """The few candidates that explain most of the residual at first order, by one linear regression each."""
    from identification.kinematics.chain import position_jacobian
    from identification.kinematics.observability import scaled_jacobian

    now = fit(
        parameters,
        _with(points, chosen, deflect, good),
        start=start.values,
        extension_scale=prior_scales(chosen),
    )
    thin = slice(None, None, max(1, len(points) // 4000))
    part = points.where(thin)
    whole = _with(points, chosen, deflect, good).where(thin)
    bent = whole.bent(now.extension)
    residual = residuals(parameters, now.values, now.extension, whole).ravel()
    chain = parameters.chain.at(now.values)
    known = scaled_jacobian(parameters, part.q).reshape(len(residual), -1)
    basis = np.linalg.qr(known / np.linalg.norm(known, axis=0).clip(1e-12))[0]
    joint = position_jacobian(chain, bent)[1][:, :, chain.joint_steps()]
    gains = []
    for extension in remaining:
        columns = (joint @ deflect([extension])[good][thin]).reshape(len(residual), -1)
        columns = columns - basis @ (basis.T @ columns)
        weights, *_ = np.linalg.lstsq(columns, residual, rcond=1e-10)
        gains.append(float(residual @ residual - np.sum((residual - columns @ weights) ** 2)))
    order = np.argsort(gains)[::-1][:most]
    return [remaining[k] for k in order]


def _with(points: Points, chosen: Sequence[Extension], deflect: Callable[[Sequence[Extension]], Array], good: Array) -> Points:
    return Points(points.q, points.xyz, deflect(chosen)[good] if chosen else None)


def _left_out(parameters: Parameters, points: Points, fold: Array, chosen: Sequence[Extension], start: Fit) -> Array:
    """Squared residual length (N,) of every point, each from a fit without its fold."""
    squares = np.empty(len(points))
    for k in np.unique(fold):
        seen = fold != k
        one = fit(parameters, points.where(seen), start=start.values, extension_scale=prior_scales(chosen))
        unseen = residuals(parameters, one.values, one.extension, points.where(~seen))
        squares[~seen] = np.sum(unseen**2, axis=1)
    return squares


def _folds(blocks: Array, folds: int) -> Array:
    names, index = np.unique(blocks, return_inverse=True)
    order = np.random.default_rng(1).permutation(len(names))
    return (order % min(folds, max(2, len(names))))[index]


def _judge(extension: Extension, before: Array, after: Array, blocks: Array) -> Trial:
    _, index = np.unique(blocks, return_inverse=True)
    gain = np.bincount(index, before - after)
    error = float(np.sqrt(np.sum((gain - gain.mean()) ** 2) * len(gain) / max(len(gain) - 1, 1)))
    z = float(gain.sum() / max(error, 1e-300))
    rms_before, rms_after = (float(np.sqrt(np.mean(s) / 3.0)) for s in (before, after))
    return Trial(extension, rms_before, rms_after, z, bool(z > 3.0 and rms_after < 0.98 * rms_before))
