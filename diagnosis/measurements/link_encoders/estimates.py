"""Parameters of causes from the two encoders of a joint, with standard deviations."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.linalg import block_diag

from arm_io.types import Array
from arm_model import Arm
from diagnosis.cause import Estimate
from diagnosis.measurements.link_encoders.columns import LinkCandidate, turns
from diagnosis.measurements.link_encoders.delay import delays_by_joint
from diagnosis.measurements.link_encoders.model import LIMITS, Chosen, LinkEncoders
from diagnosis.measurements.link_encoders.model_errors import directions
from diagnosis.selection.estimates import estimates
from identification.selection import BLOCK_SECONDS
from identification.selection.cluster_covariance import cluster_covariance


def parameters_of(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders, arm: Arm) -> list[Estimate]:
    """Values and std, by the sandwich of block scores."""
    effect, rows, joint = candidate.definition, model.whole, arm.joints[(candidate.joint or 1) - 1]
    values, covariance = coefficients(chosen, model)
    at = len(rows.joints) + sum(c.width for c in chosen[: chosen.index(candidate)])
    place = slice(at, at + candidate.width)
    c, covariance, systematic = values[place].tolist(), covariance[place, place], LIMITS.systematic
    if effect.delay is not None:
        # the scatter between joints includes errors of the measurement model
        delays, systematic = delays_by_joint(model.without(candidate, chosen), model), 0.0
        covariance = covariance + (np.var(delays, ddof=1) / len(delays) if len(delays) > 1 else 0.0)
    if effect.wave:
        k = int(np.flatnonzero(rows.joints == candidate.joint)[0])
        covariance = block_diag(covariance, np.array([[(0.1 / turns(rows, k)) ** 2]]))
    order = [p.name for p in effect.parameters if p.whole]
    found = estimates(candidate, c, covariance, joint if candidate.joint else None, systematic, order)
    if effect.spring is not None and effect.gap is None:
        damping, std = _damping(candidate, chosen, model, found[0].value)
        found.append(Estimate("damping", damping, std, joint.unit("N m s/rad")))
    return found


def _damping(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders, stiffness: float) -> tuple[float, float]:
    """Damping N m s/rad (N s/m) of a spring and its standard deviation.

    By k d + c d' = load the twist lags by c / k: d = load / k - c / k^2 load'. The stamps of two encoders agree to half
    a row at best. A damping that is not significantly different from zero is set to its standard deviation: a spring
    without damping would oscillate for ever.
    """
    rows = model.whole
    k = int(np.flatnonzero(rows.joints == candidate.joint)[0])
    residual, edges = model.residual(chosen, rows, rows)[:, k], [*rows.starts, rows.rows]
    late = np.concatenate([np.gradient(rows.load[a:b, k], rows.t[a:b]) for a, b in itertools.pairwise(edges)])
    late = late - late.mean()
    size = float(late @ late)
    slope = float(late @ residual) / size
    scores = np.bincount(rows.blocks(BLOCK_SECONDS), weights=late * (residual - slope * late))
    half_row = float(np.median(np.diff(rows.t))) / 2
    std = float(np.hypot(np.sqrt(scores @ scores) / size * stiffness**2, stiffness * half_row))
    damping = -slope * stiffness**2
    return (damping if damping > std else std), std


def coefficients(chosen: Chosen, model: LinkEncoders) -> tuple[Array, Array]:
    """Coefficients (c,) of the rows that parameters are estimated from, and their covariance, clustered by block."""
    x = model.stacked(chosen, model.whole)
    values = model.fitted(chosen, model.whole)
    y = model.response(model.whole)
    residual, block = y - x @ values, np.tile(model.whole.blocks(BLOCK_SECONDS), len(model.whole.joints))
    # an error of the load moves the coefficients that follow from it
    errors = directions(chosen, values, model.whole).reshape(len(y), -1)
    moved = np.linalg.pinv(x) @ (errors / np.repeat(model.scale, model.whole.rows)[:, None])
    return values, cluster_covariance(x, [residual], block) + moved @ moved.T
