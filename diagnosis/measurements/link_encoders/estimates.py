"""Parameters of causes from the two encoders of a joint, with standard deviations."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from arm_io.types import Array
from arm_model import Arm
from diagnosis.cause import Estimate
from diagnosis.measurements.link_encoders.candidates import LinkCandidate, turns
from diagnosis.measurements.link_encoders.delay import delays_by_joint
from diagnosis.measurements.link_encoders.model import LIMITS, Chosen, LinkEncoders
from diagnosis.measurements.link_encoders.model_errors import directions
from diagnosis.measurements.link_encoders.per_recording import place_of
from diagnosis.selection.estimates import estimates
from identification.selection import BLOCK_SECONDS
from identification.selection.cluster_covariance import cluster_covariance


def parameters_of(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders, arm: Arm) -> list[Estimate]:
    """Values and std, by the sandwich of block scores."""
    effect, rows, joint = candidate.definition, model.whole, arm.joints[(candidate.joint or 1) - 1]
    values, covariance = coefficients(chosen, model)
    place = place_of(candidate, chosen, model)
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
        damping, std = found[0].value * np.array(lag_of(candidate, chosen, model))
        found.append(Estimate("damping", float(damping), float(std), joint.unit("N m s/rad")))
    return found


def lag_of(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders) -> tuple[float, float]:
    """s by which the twist of a chosen spring lags its load, and its standard deviation.

    By k d + c d' = load the twist lags by c / k: d = (load - c / k load') / k. The stamps of two encoders agree to half
    a row at best. A lag that is not significantly different from zero is set to its standard deviation: a spring
    without damping would oscillate for ever.
    """
    rows = model.whole
    k = int(np.flatnonzero(rows.joints == candidate.joint)[0])
    residual = model.residual(chosen, rows, rows)[:, k]
    compliance = float(model.fitted(chosen, rows)[place_of(candidate, chosen, model)][0])
    late = rows.load_rate[:, k] - rows.load_rate[:, k].mean()
    size = float(late @ late) * compliance
    more = -float(late @ residual) / size
    scores = np.bincount(rows.blocks(BLOCK_SECONDS), weights=late * (residual + more * compliance * late))
    half_row = float(np.median(np.diff(rows.t))) / 2
    std = float(np.hypot(np.sqrt(scores @ scores) / size, half_row))
    return max(candidate.lag + more, std), std


def coefficients(chosen: Chosen, model: LinkEncoders) -> tuple[Array, Array]:
    """Coefficients (c,) of the rows that parameters are estimated from, and their covariance, clustered by block."""
    x = model.stacked(chosen, model.whole)
    values = model.fitted(chosen, model.whole)
    y = model.response(chosen, model.whole)
    residual, block = y - x @ values, np.tile(model.whole.blocks(BLOCK_SECONDS), len(model.whole.joints))
    # an error of the load moves the coefficients that follow from it
    errors = directions(chosen, values, model.whole).reshape(len(y), -1)
    moved = np.linalg.pinv(x) @ (errors / np.repeat(model.scale, model.whole.rows)[:, None])
    return values, cluster_covariance(x, [residual], block) + moved @ moved.T
