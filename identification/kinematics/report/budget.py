"""The uncertainty of a position that the calibrated arm predicts, source by source (JCGM 100, the GUM)."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import stats

from identification.kinematics.data.recordings import Gravity
from identification.kinematics.data.runs import points_of, thinned, velocity_of
from identification.kinematics.estimation.calibration import Calibration
from identification.kinematics.estimation.extensions import deflections
from identification.kinematics.estimation.observed import linear_in
from identification.kinematics.report.points import repeated_poses

K = 2.0
"""Coverage factor: 95 % of a coordinate."""
IN_SPACE = float(np.sqrt(stats.chi2.ppf(0.95, 3)))
"""Distance that 95 % of the points stay below, in standard uncertainties of a coordinate, equal in all directions."""
MOST = 2000
"""Points at which the uncertainty of the parameters is evaluated."""
NOT_CONTAINED = (
    "scale error and drift of the tracker, another temperature of the arm, other loads than those of the measurement, "
    "and poses outside the measured ones"
)


def uncertainty(calibration: Calibration, gravity: Gravity | None) -> dict[str, Any]:
    """Standard uncertainties, m per coordinate, of the difference between a measured and a predicted position.

    components  source, std, type of evaluation, degrees_of_freedom (None: not stated), how it was found. What held-out
                points show beyond the others, from what the model lacks or by chance, is a component of its own.
    combined    root of the sum of squares; expanded: ``K`` times that; in_space: 95 % of distances are below
    repeated    ``repeated_poses``: a part of the noise of the points, no further component
    """
    points = _judged(calibration, gravity)
    chain, free = calibration.chain, calibration.parameters.free
    columns = linear_in(chain, points, calibration.fit.extension if calibration.extensions else None)[1][:, :, free]
    covariance = calibration.fit.covariance[: len(free), : len(free)] * calibration.correlated
    # below zero by rounding, where the points hardly determine a parameter and have no noise
    variance = max(float(np.einsum("nij,jk,nik->ni", columns, covariance, columns).mean()), 0.0)
    fitted = float(np.sqrt(variance))
    noise, zeros = calibration.fit.noise, calibration.zero_error
    error = float(np.nan_to_num(calibration.after["held_out"].rms_inliers))
    promised = noise**2 + fitted**2 + zeros**2
    rest = float(np.sqrt(max(error**2 - promised, 0.0)))
    judged = max(3 * calibration.after["held_out"].points / calibration.correlated, 1.0)
    chance = float(np.sqrt(promised * max(stats.chi2.ppf(0.95, judged) / judged - 1.0, 0.0)))
    used = 3 * float(calibration.fit.inlier.sum()) / calibration.correlated - calibration.fit.effective
    stated = noise == calibration.runs[0].std
    components = [
        _component(
            "noise of the points",
            noise,
            "B" if stated else "A",
            None if stated else max(used, 1.0),
            "as stated" if stated else "residuals of the fit: the tracker, and what the arm does not repeat",
        ),
        _component("estimated parameters", fitted, "A", None, "covariance of the fit at the judged points"),
        _component("zeros of counters", zeros, "B", None, "a count of every encoder whose zero is set at a start"),
        _component(
            "excess of held-out points",
            rest,
            "A",
            judged,
            f"error beyond the three above: what the model lacks; by chance up to {1e3 * chance:.2g} mm (95 %)",
        ),
    ]
    combined = float(np.sqrt(sum(one["std"] ** 2 for one in components)))
    return {
        "components": components,
        "combined": combined,
        "coverage_factor": K,
        "expanded": K * combined,
        "in_space": IN_SPACE * combined,
        "not_contained": NOT_CONTAINED,
        "repeated": repeated_poses(calibration, gravity),
    }


def _component(source: str, std: float, kind: str, freedom: float | None, how: str) -> dict[str, Any]:
    return {"source": source, "std": std, "type": kind, "degrees_of_freedom": freedom, "how": how}


def _judged(calibration: Calibration, gravity: Gravity | None) -> Any:
    """Positions of the runs that judge the calibration, with the deflections of its effects."""
    rows = thinned(calibration.held_out, MOST)
    points = points_of(calibration.held_out, rows)
    if calibration.extensions:
        speed = velocity_of(calibration.held_out, rows)
        points = points.deflected(deflections(calibration.extensions, points.q, velocity=speed, gravity=gravity))
    return points.where(~points.oriented)
