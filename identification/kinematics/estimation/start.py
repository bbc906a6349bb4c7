"""Where a calibration begins: the pose of the tracker, circles of sweeps, least squares on all points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm
from identification.kinematics.circle_points.circle_points import circle_points
from identification.kinematics.data.measured import Measured
from identification.kinematics.data.points import Points
from identification.kinematics.data.runs import aligned
from identification.kinematics.estimation.estimated import Estimated, Settings
from identification.kinematics.estimation.map_estimation import Fit, fit, residuals
from identification.kinematics.estimation.observed import linear_in
from identification.kinematics.estimation.orientation import with_aims, with_lever
from identification.kinematics.models.chain import position, xyz_ypr
from identification.kinematics.models.parameters import Parameters, Target, Trust, base_pose, is_target, parameters_of

WRONG_FRAME = 0.1
"""m: median distance of the points in a stated tracker frame from which that frame is wrong, if a fitted one leaves
less than a quarter of it."""
_WEIGHINGS = 10
"""Most weights of orientations that are tried; more than four were never needed."""
_SAME_WEIGHT = 0.05
"""Relative change of a weight below which it stays: far less than 40 noises of points tell of it."""


def first_fit(
    arm: Arm, measured: Measured, targets: Sequence[Target], settings: Settings, progress: Progress
) -> Estimated:
    """Least squares on all points, from the nominal arm or from circles."""
    warnings: list[str] = []
    frame_known, nominal = place_tracker(arm, measured.points, targets, settings.frame_known, warnings)
    parameters = parameters_of(arm, targets, frame_known=frame_known, trust=settings.trust)
    first = parameters.chain.at(nominal)
    measured = with_aims(measured, first)
    progress("circles of single-joint sweeps")
    circles = circle_points(arm, targets[0], measured.runs, first)
    progress("least squares on all points")
    points = measured.points
    found = fit(parameters, points, start=best_start(parameters, points, nominal, circles.values))
    measured, found = _weighed(parameters, measured, found)
    return Estimated(
        arm=arm,
        settings=settings,
        targets=tuple(targets),
        frame_known=frame_known,
        measured=measured,
        first=first,
        circles=circles,
        parameters=parameters,
        points=measured.points,
        fit=found,
        warnings=tuple(warnings),
    )


def _weighed(parameters: Parameters, measured: Measured, found: Fit) -> tuple[Measured, Fit]:
    """The runs with orientations weighed by their noise, and the fit to them, from a fit ``found`` by another weight.

    Noises and estimate depend on each other: orientations that count too little beside positions, or too much, take
    the error of the others. They are estimated in turn until the weight stays.
    """
    for _ in range(_WEIGHINGS):
        before, points = measured.points.lever, measured.points
        measured = with_lever(measured, *_left(parameters, found, points))
        after = measured.points.lever
        if before is None or after is None or np.allclose(after, before, rtol=_SAME_WEIGHT):
            break
        found = fit(parameters, measured.points, start=found.values)
    return measured, found


def _left(parameters: Parameters, found: Fit, points: Points) -> tuple[Array, Array]:
    """Residuals (N, 3) m of the points, and (N,) which share of the noise's variance the fit left in each."""
    residual, every = linear_in(parameters.chain.at(found.values), points)
    columns = every[:, :, parameters.free]
    absorbed = np.einsum("nij,jk,nik->n", columns, found.covariance, columns) / (3.0 * found.noise**2)
    return residual, np.where(found.inlier, np.clip(1.0 - absorbed, 0.0, 1.0), 1.0)


def place_tracker(
    arm: Arm, points: Points, targets: Sequence[Target], frame_known: bool, warnings: list[str]
) -> tuple[bool, Array]:
    """Whether the tracker's frame can be taken as known, and the values (values,) rad, m of the chain to begin from."""
    points = points.where(~points.oriented)
    parameters = parameters_of(arm, targets, frame_known=frame_known, trust=Trust())
    chain = parameters.chain
    at = position(chain, points.q, points.target)
    pose = aligned(at, points.xyz)
    as_given = float(np.median(np.linalg.norm(points.xyz - at, axis=1)))
    laid_over = float(np.median(np.linalg.norm(points.xyz - at @ pose[:3, :3].T - pose[:3, 3], axis=1)))
    if frame_known and as_given > WRONG_FRAME and laid_over < as_given / 4:
        frame_known = False
        warnings.append(
            f"the median distance of the points from the model is {1e3 * as_given:.0f} mm in the stated tracker frame "
            f"and {1e3 * laid_over:.1f} mm after a fit of the frame: the frame was taken as unknown and estimated"
        )
    if frame_known:
        return True, chain.values
    correction = np.linalg.inv(np.array(arm.base)) @ pose @ base_pose(chain)
    place = dict(zip(("x", "y", "z", "yaw", "pitch", "roll"), xyz_ypr(correction), strict=True))
    values = [place[s.name[5:]] if s.name.startswith("base.") else s.value for s in chain.steps]
    return False, np.array(values)


def with_nominal_target(parameters: Parameters, values: Array) -> Array:
    """(v,) the values with the target at its nominal place, which circle-point analysis alone assumes."""
    values, nominal = values.copy(), parameters.chain.values
    for k, name in enumerate(parameters.chain.names):
        if is_target(name):
            values[k] = nominal[k]
    return values


def best_start(parameters: Parameters, points: Points, nominal: Array, circles: Array | None) -> Array:
    """(v,) the nominal values or those from circles, whichever has the smaller median distance to the points."""
    starts = [nominal] if circles is None else [nominal, with_nominal_target(parameters, circles)]
    plain = points.where(~points.oriented).deflected(None)
    off = [float(np.median(np.linalg.norm(residuals(parameters, s, np.zeros(0), plain), axis=1))) for s in starts]
    return starts[int(np.argmin(off))]
