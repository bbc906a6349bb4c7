"""How good a calibration is, on all points, and whether success may be claimed.

"Before" is the nominal arm after the best fit of frame and target: what a laboratory that knows neither would see. So
an error of the survey is not counted as an improvement of the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.blocks import blocks
from identification.kinematics.data.points import Points
from identification.kinematics.data.runs import Run, points_of, thinned, velocity_of
from identification.kinematics.estimation.extensions import deflections, prior_scales
from identification.kinematics.estimation.map_estimation import REJECT, Fit, fit, residuals
from identification.kinematics.estimation.observability import expected_rank
from identification.kinematics.estimation.observed import linear_in, residual_of
from identification.kinematics.estimation.position_error import LeftOut, PositionError, far, position_error
from identification.kinematics.estimation.work import OUTLIERS, Work, pattern
from identification.kinematics.models.chain import Chain, Index, Mask
from identification.kinematics.models.parameters import (
    UNKNOWN_FRAME,
    UNKNOWN_TARGET,
    Parameters,
    is_target,
    target_groups,
)

MOST_JUDGED = 100_000
"""Points of one part on which errors are computed; more are evenly thinned."""
FOLDS = 10
"""Parts of a small set of poses that are held out in turn."""
_LISTED = 12
"""Rows that a message lists."""
_REFUTED = 5.0
"""Held-out error over the one that the fit promises, above which the model is refuted."""
_PROMISED = 2000
"""Points on which that is computed."""
_PRIOR = 25.0
"""Chi-square of three target coordinates against their prior, above which it is said: once in 65000."""
_COARSE = 5e-3
"""m per coordinate: no arm repeats its poses worse."""


@dataclass(frozen=True)
class Judgement:
    """Errors {"fit": ..., "held_out": ...} before and after, the points left out, and reasons why it is no success.

    orientation: rms rad of orientations, {"fit": {"before", "after"}, ...}; {} without.
    """

    before: dict[str, PositionError]
    after: dict[str, PositionError]
    orientation: dict[str, dict[str, float]]
    left_out: tuple[LeftOut, ...]
    failures: tuple[str, ...]


def judged(work: Work, nominal: Chain) -> Judgement:
    """The errors of a finished calibration, and what refutes it. nominal: see ``best_frame_and_target``."""
    before, after, left_out, orientation = {}, {}, [], {}
    for part, runs in (("fit", work.runs), ("held_out", work.held_out)):
        rows = thinned(runs, MOST_JUDGED)
        points = points_of(runs, rows)
        residual = _residual(work, runs, rows, part)
        outlier = _outlier(work, part, residual, points)
        as_was = residual_of(nominal, replace(points, q=as_nominal(work, points.q)))
        placed = ~points.oriented
        before[part] = position_error(as_was[placed], outlier[placed])
        after[part] = position_error(residual[placed], outlier[placed])
        if points.lever is not None and not placed.all():
            both = (("before", as_was), ("after", residual))
            lever = points.lever[~placed, None]
            orientation[part] = {when: float(np.sqrt(np.mean((off[~placed] / lever) ** 2))) for when, off in both}
        left_out += _by_run(part, runs, rows, residual, outlier)
    # a blunder is as far off before as after, and hides what becomes of the others
    was, now = before["held_out"].rms_inliers, after["held_out"].rms_inliers
    if now >= was:
        work.warnings.append(
            f"the held-out error does not fall ({1e3 * was:.3g} mm before, {1e3 * now:.3g} mm after): calibration "
            "does not improve this model; keep the nominal model"
        )
    return Judgement(before, after, orientation, tuple(left_out), tuple(_failures(work, before, after, left_out)))


def best_frame_and_target(work: Work) -> Chain:
    """The nominal arm where frame and target fit the points best that the calibration fits."""
    inlier = work.estimate.inlier
    points = points_of(work.runs, work.rows)
    points = replace(points, q=as_nominal(work, points.q)).where(inlier)
    names = work.parameters.chain.names
    scale = np.zeros(len(names))
    for k, name in enumerate(names):
        if name.startswith("base.") or (is_target(name) and name.endswith(("yaw", "pitch", "roll"))):
            scale[k] = UNKNOWN_FRAME
        elif is_target(name):
            scale[k] = UNKNOWN_TARGET
    free = np.flatnonzero(scale)
    chain = work.parameters.chain
    start = work.first if not work.settings.frame_known else chain
    known = Parameters(start, free, work.parameters.every, scale)
    return chain.at(fit(known, points, reject=False).values)


def as_nominal(work: Work, q: Array) -> Array:
    """Link angles (N, joints) as the nominal model has them, for those of the calibrated one."""
    if np.array_equal(work.coupling, work.arm.coupling_matrix):
        return q
    return np.asarray(q @ (work.arm.coupling_matrix @ np.linalg.inv(work.coupling)).T, float)


def weaknesses(work: Work, rank: int) -> list[str]:
    """Warnings: parameters that the poses do not determine, a target off its prior, points that were left out."""
    found = []
    moving = work.moving
    prismatic = sum(not work.arm.joints[j - 1].revolute for j in moving)
    oriented = sum(target.oriented for target in work.targets)
    most = expected_rank(len(moving) - prismatic, prismatic, len(work.targets), oriented)
    if rank < most:
        found.append(f"{rank} of {most} parameters are identifiable from these poses; record more varied poses")
    chain = work.parameters.chain
    for group, one in zip(target_groups(len(work.targets)), work.targets):
        at = [chain.names.index(f"{group}.{axis}") for axis in "xyz"]
        off = (work.estimate.values - chain.values)[at]
        chi_square = float(np.sum((off / one.std) ** 2))
        if one.given and chi_square > _PRIOR:
            name = one.name and f" {one.name}"
            found.append(
                f"the target{name} is {1e3 * np.linalg.norm(off):.2f} mm from the given position, whose standard "
                f"deviation is {1e3 * one.std:g} mm (chi-square {chi_square:.0f} of 3): --target-std is too small"
            )
    return found


def _residual(work: Work, runs: Sequence[Run], rows: Sequence[Index], part: str) -> Array:
    """(N, 3) m: measured less predicted; of held-out poses of cross-validation, each predicted without its fold."""
    points = points_of(runs, rows)
    bend = deflections(work.extensions, points.q, velocity=velocity_of(runs, rows), gravity=work.settings.gravity)
    points = points.deflected(bend if work.extensions else None)
    if part == "fit" or work.judged_by != "cross-validation":
        return residuals(work.parameters, work.estimate.values, work.estimate.extension, points)
    number = blocks(runs, rows)
    fold = (np.random.default_rng(1).permutation(int(number.max()) + 1) % FOLDS)[number]
    residual = np.empty_like(points.xyz)
    for k in np.unique(fold):
        found = _refitted(work, points.where(fold != k))
        residual[fold == k] = residuals(work.parameters, found.values, found.extension, points.where(fold == k))
    return residual


def _refitted(work: Work, points: Points) -> Fit:
    """The same parameters and extensions from other points."""
    return fit(
        work.parameters,
        points,
        start=work.estimate.values,
        extension_scale=prior_scales(work.extensions),
        extension_start=work.estimate.extension,
    )


def _outlier(work: Work, part: str, residual: Array, points: Points) -> Mask:
    """(N,) bool: points left out of the fit.

    Held-out ones and those that the fit did not use: far off by the scale of the others, and by the deviation that the
    fit promises there.
    """
    if part == "fit" and len(residual) == len(work.estimate.inlier):
        return np.asarray(~work.estimate.inlier, bool)
    outlier = far(residual, points.std)
    some = np.flatnonzero(outlier)
    covariance = _promised(work, points.where(some)) + work.estimate.noise**2 * np.eye(3)
    off = residual[some]
    outlier[some] = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0]) > REJECT**2
    return outlier


def _promised(work: Work, points: Points) -> Array:
    """(N, 3, 3) m2: covariance of predicted points, by that of the estimate."""
    free = work.parameters.free
    columns = linear_in(work.parameters.chain.at(work.estimate.values), points)[1][:, :, free]
    return columns @ work.estimate.covariance[: len(free), : len(free)] @ np.swapaxes(columns, 1, 2)


def _by_run(part: str, runs: Sequence[Run], rows: Sequence[Index], residual: Array, outlier: Mask) -> list[LeftOut]:
    found, first = [], 0
    for run, which in zip(runs, rows, strict=True):
        here = np.flatnonzero(outlier[first : first + len(which)])
        if len(here):
            distance = np.linalg.norm(residual[first + here], axis=1) / (run.lever or 1.0)
            row = which[here] if run.file_row is None else run.file_row[which[here]]
            found.append(LeftOut(part, run.name, row + 1, distance))
        first += len(which)
    return found


def _failures(
    work: Work, before: dict[str, PositionError], after: dict[str, PositionError], left_out: Sequence[LeftOut]
) -> list[str]:
    found = []
    noise = work.estimate.noise
    share = pattern(work)
    for part, words in (("fit", "fitted"), ("held_out", "held-out")):
        out, points = after[part].outliers, after[part].points
        if out <= OUTLIERS * points:
            continue
        rows = ", ".join(_rows(one) for one in left_out if one.part == part)
        alike = f"; they share {share}" if share and part == "fit" else ""
        found.append(
            f"{out} of {points} {words} poses ({100 * out / points:.0f} %) contradict the model: {rows}{alike}. "
            f"rms over all {words} points {1e3 * before[part].rms:.3g} -> {1e3 * after[part].rms:.3g} mm"
        )
    if not found and share:
        rows = ", ".join(_rows(one) for one in left_out if one.part == "fit")
        work.warnings.append(f"the outliers ({rows}) share {share}: there the model lacks an effect")
    promised = _expected(work)
    most = work.settings.most_noise
    if (reached := after["held_out"].rms_inliers) > max(_REFUTED * promised, most):
        found.append(
            f"the error of the held-out points is {1e3 * reached:.3g} mm rms per coordinate, the error expected from "
            f"the fit {1e3 * promised:.3g} mm: the model is valid for the fitted poses only"
        )
    if noise > most:
        than = "was stated" if work.settings.point_std else "a tracker has"
        found.append(
            f"{1e3 * noise:.3g} mm rms per coordinate remain, more noise than {than} (at most {1e3 * most:.3g} mm): "
            "the model does not describe the poses"
        )
    if found and not work.settings.extend:
        found.append(
            "couplings of joints, joints that count backwards, sag and encoder errors were not tried; leave out "
            "--geometry-only to try them"
        )
    if found and not work.settings.point_std and max(one.rms for one in after.values()) < _COARSE:
        found.append(
            "if the arm itself does not return to a pose more exactly (backlash), state the standard deviation of a "
            "coordinate with --point-std M"
        )
    return found


def _expected(work: Work) -> float:
    """m rms per coordinate of the held-out points, as the covariance of the estimate and the noise promise."""
    points = points_of(work.held_out, thinned(work.held_out, _PROMISED))
    model = np.trace(_promised(work, points), axis1=1, axis2=2) / 3.0
    return float(np.sqrt(work.estimate.noise**2 + np.mean(model)))


def _rows(one: LeftOut) -> str:
    listed = ", ".join(map(str, one.rows[:_LISTED])) + (" ..." if len(one.rows) > _LISTED else "")
    return f"{one.run} row{'s' if len(one.rows) > 1 else ''} {listed}"
