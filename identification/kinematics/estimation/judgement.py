"""How good a calibration is, on all points, and whether success may be claimed.

"Before" is the nominal arm after the best fit of frame and target: what a laboratory that knows neither would see. So
an error of the survey is not counted as an improvement of the arm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from arm_io.types import Array
from identification.kinematics.data.blocks import blocks
from identification.kinematics.data.points import Points
from identification.kinematics.data.runs import Run, points_of, thinned, velocity_of
from identification.kinematics.estimation.estimated import Estimated
from identification.kinematics.estimation.extensions import deflections, prior_scales
from identification.kinematics.estimation.map_estimation import REJECT, Fit, fit, fit_every_point, residuals
from identification.kinematics.estimation.observability import expected_rank
from identification.kinematics.estimation.observed import linear_in, residual_of
from identification.kinematics.estimation.outlier_pattern import OUTLIERS, pattern
from identification.kinematics.estimation.position_error import LeftOut, PositionError, far, position_error
from identification.kinematics.models.chain import Chain, Index, Mask
from identification.kinematics.models.parameters import (
    UNKNOWN_FRAME,
    UNKNOWN_TARGET,
    Parameters,
    is_target,
    parallel_next,
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
    warnings: tuple[str, ...]


def judged(estimated: Estimated, nominal: Chain) -> Judgement:
    """The errors of a finished calibration, and what refutes it. nominal: see ``best_frame_and_target``."""
    before, after, left_out, orientation = {}, {}, [], {}
    for part, runs in (("fit", estimated.measured.runs), ("held_out", estimated.measured.held_out)):
        rows = thinned(runs, MOST_JUDGED)
        points = points_of(runs, rows)
        residual, spread = _predicted(estimated, runs, rows, part)
        outlier = _outlier(estimated, part, residual, points, spread)
        as_was = residual_of(nominal, replace(points, q=as_nominal(estimated, points.q)))
        placed = ~points.oriented
        before[part] = position_error(as_was[placed], outlier[placed])
        after[part] = position_error(residual[placed], outlier[placed])
        if points.lever is not None and not placed.all():
            both = (("before", as_was), ("after", residual))
            lever = points.lever[~placed, None]
            orientation[part] = {when: float(np.sqrt(np.mean((off[~placed] / lever) ** 2))) for when, off in both}
        left_out += _by_run(part, runs, rows, residual, outlier)
    # an outlier is as far off before as after, and hides what becomes of the others
    was, now = before["held_out"].rms_inliers, after["held_out"].rms_inliers
    warnings = []
    if now >= was:
        warnings.append(
            f"the held-out error does not fall ({1e3 * was:.3g} mm before, {1e3 * now:.3g} mm after): calibration "
            "does not improve this model; keep the nominal model"
        )
    share = pattern(estimated)
    contradicting = _contradicting(before, after, left_out, share)
    if share and not contradicting:
        listed = ", ".join(_rows(one) for one in left_out if one.part == "fit")
        warnings.append(f"the outliers ({listed}) share {share}: there the model lacks an effect")
    failures = _with_advice(estimated, [*contradicting, *_inexact(estimated, after)], after)
    return Judgement(before, after, orientation, tuple(left_out), tuple(failures), tuple(warnings))


def best_frame_and_target(estimated: Estimated) -> Chain:
    """The nominal arm where frame and target fit the points best that the calibration fits."""
    inlier = estimated.fit.inlier
    points = estimated.measured.points
    points = replace(points, q=as_nominal(estimated, points.q)).where(inlier)
    names = estimated.parameters.chain.names
    scale = np.zeros(len(names))
    for k, name in enumerate(names):
        if name.startswith("base.") or (is_target(name) and name.endswith(("yaw", "pitch", "roll"))):
            scale[k] = UNKNOWN_FRAME
        elif is_target(name):
            scale[k] = UNKNOWN_TARGET
    free = np.flatnonzero(scale)
    chain = estimated.parameters.chain
    start = estimated.first if not estimated.frame_known else chain
    known = Parameters(start, free, estimated.parameters.every, scale)
    return chain.at(fit_every_point(known, points).values)


def as_nominal(estimated: Estimated, q: Array) -> Array:
    """Link angles (N, joints) as the nominal model has them, for those of the calibrated one."""
    if np.array_equal(estimated.measured.coupling, estimated.arm.coupling_matrix):
        return q
    return np.asarray(q @ (estimated.arm.coupling_matrix @ np.linalg.inv(estimated.measured.coupling)).T, float)


def weaknesses(estimated: Estimated, rank: int) -> list[str]:
    """Warnings: parameters that the poses do not determine, a target off its prior, points that were left out."""
    found = []
    moving = estimated.moving
    prismatic = sum(not estimated.arm.joints[j - 1].revolute for j in moving)
    oriented = sum(target.oriented for target in estimated.targets)
    most = expected_rank(len(moving) - prismatic, prismatic, len(estimated.targets), oriented)
    if rank < most:
        found.append(f"{rank} of {most} parameters are identifiable from these poses; record more varied poses")
    chain = estimated.parameters.chain
    for group, one in zip(target_groups(len(estimated.targets)), estimated.targets):
        at = [chain.names.index(f"{group}.{axis}") for axis in "xyz"]
        off = (estimated.fit.values - chain.values)[at]
        chi_square = float(np.sum((off / one.std) ** 2))
        if one.given and chi_square > _PRIOR:
            name = one.name and f" {one.name}"
            found.append(
                f"the target{name} is {1e3 * np.linalg.norm(off):.2f} mm from the given position, whose standard "
                f"deviation is {1e3 * one.std:g} mm (chi-square {chi_square:.0f} of 3): --target-std is too small"
            )
    return found + list(_on_one_line(estimated))


def _on_one_line(estimated: Estimated) -> Iterator[str]:
    """A sentence per pair of neighbouring joints that nominally turn about nearly the same line.

    D-H parameters are singular there: an error of a line's place turns their common normal by any angle.
    """
    arm, near = estimated.arm, estimated.settings.trust.length
    for j, parallel in enumerate(parallel_next(arm)):
        first = j - 1 if arm.joints[j].convention == "modified" else j
        if parallel and arm.joints[first].revolute and arm.joints[first + 1].revolute and abs(arm.joints[j].a) <= near:
            yield (
                f"joints {first + 1} and {first + 2} turn about lines {1e3 * abs(arm.joints[j].a):.2g} mm apart: D-H "
                "parameters do not describe small errors of such lines, and a part of the error may remain"
            )


def _predicted(
    estimated: Estimated, runs: Sequence[Run], rows: Sequence[Index], part: str
) -> tuple[Array, Array | None]:
    """Measured less predicted (N, 3) m; of cross-validated points each predicted without its fold.

    Of these also (N, 3, 3) m2, the covariance of their predictions by the fits without them; of others None.
    """
    points = points_of(runs, rows)
    bend = deflections(
        estimated.extensions, points.q, velocity=velocity_of(runs, rows), gravity=estimated.settings.gravity
    )
    points = points.deflected(bend if estimated.extensions else None)
    if part == "fit" or estimated.measured.judged_by != "cross-validation":
        return residuals(estimated.parameters, estimated.fit.values, estimated.fit.extension, points), None
    number = blocks(runs, rows)
    fold = (np.random.default_rng(1).permutation(int(number.max()) + 1) % FOLDS)[number]
    residual, spread = np.empty_like(points.xyz), np.empty((len(points), 3, 3))
    for k in np.unique(fold):
        judged_by, here = _refitted(estimated, points.where(fold != k)), points.where(fold == k)
        residual[fold == k] = residuals(estimated.parameters, judged_by.values, judged_by.extension, here)
        # few points may fit themselves by chance: all of them know the noise better
        luck = max(1.0, (estimated.fit.noise / judged_by.noise) ** 2)
        spread[fold == k] = luck * _promised(estimated.parameters, judged_by, here)
    return residual, spread


def _refitted(estimated: Estimated, points: Points) -> Fit:
    """The same parameters and extensions from other points."""
    return fit(
        estimated.parameters,
        points,
        start=estimated.fit.values,
        extension_scale=prior_scales(estimated.extensions),
        extension_start=estimated.fit.extension,
    )


def _outlier(estimated: Estimated, part: str, residual: Array, points: Points, spread: Array | None) -> Mask:
    """(N,) bool: points left out of the fit.

    Held-out ones and those that the fit did not use: far off by the scale of the others, and by the deviation that the
    fit promises there; ``spread`` (N, 3, 3) m2 is its square where another fit than the final one predicted them.
    """
    if part == "fit" and len(residual) == len(estimated.fit.inlier):
        return np.asarray(~estimated.fit.inlier, bool)
    outlier = far(residual, points.std)
    some = np.flatnonzero(outlier)
    promised = _promised(estimated.parameters, estimated.fit, points.where(some)) if spread is None else spread[some]
    covariance = promised + estimated.fit.noise**2 * np.eye(3)
    off = residual[some]
    square = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0])
    outlier[some] = square > _most_square(estimated.fit)
    return outlier


def _most_square(found: Fit) -> float:
    """Squared distance of a point, over its covariance, that is exceeded as seldom as ``REJECT`` deviations.

    The covariance is known as well as the noise is: three times an F value, with the degrees of freedom that the fit
    left. For many points REJECT^2.
    """
    free = max(3.0 * float(found.inlier.sum()) - found.effective, 1.0)
    return float(3.0 * stats.f.isf(stats.chi2.sf(REJECT**2, 3), 3, free))


def _promised(parameters: Parameters, found: Fit, points: Points) -> Array:
    """(N, 3, 3) m2: covariance of predicted points, by that of the estimate."""
    columns = linear_in(parameters.chain.at(found.values), points)[1][:, :, parameters.free]
    known = found.covariance[: len(parameters.free), : len(parameters.free)]
    return columns @ known @ np.swapaxes(columns, 1, 2)


def _by_run(part: str, runs: Sequence[Run], rows: Sequence[Index], residual: Array, outlier: Mask) -> list[LeftOut]:
    found, first = [], 0
    for run, which in zip(runs, rows, strict=True):
        here = np.flatnonzero(outlier[first : first + len(which)])
        if len(here):
            distance = np.linalg.norm(residual[first + here], axis=1) / (run.lever or 1.0)
            row = which[here] if run.file_row is None else run.file_row[which[here]]
            found.append(LeftOut(part, run.name, row + 1, distance, oriented=bool(run.lever)))
        first += len(which)
    return found


def _contradicting(
    before: dict[str, PositionError], after: dict[str, PositionError], left_out: Sequence[LeftOut], share: str | None
) -> list[str]:
    """Sentences on parts of whose poses so many contradict the model that they are not at fault."""
    found = []
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
    return found


def _inexact(estimated: Estimated, after: dict[str, PositionError]) -> list[str]:
    """Sentences on errors of the points that were not left out, larger than the noise explains."""
    found = []
    noise, promised, most = estimated.fit.noise, _expected(estimated), estimated.settings.most_noise
    if (reached := after["held_out"].rms_inliers) > max(_REFUTED * promised, most):
        found.append(
            f"the error of the held-out points is {1e3 * reached:.3g} mm rms per coordinate, the error expected from "
            f"the fit {1e3 * promised:.3g} mm: the model is valid for the fitted poses only"
        )
    if noise > most:
        than = "was stated" if estimated.settings.point_std else "a tracker has"
        found.append(
            f"{1e3 * noise:.3g} mm rms per coordinate remain, more noise than {than} (at most {1e3 * most:.3g} mm): "
            "the model does not describe the poses"
        )
    return found


def _with_advice(estimated: Estimated, failures: list[str], after: dict[str, PositionError]) -> list[str]:
    """The failures, if any, and which options may help."""
    if not failures:
        return []
    found = [*failures]
    if not estimated.settings.extend:
        found.append(
            "couplings of joints, joints that count backwards, sag and encoder errors were not tried; leave out "
            "--geometry-only to try them"
        )
    if not estimated.settings.point_std and max(one.rms for one in after.values()) < _COARSE:
        found.append(
            "if the arm itself does not return to a pose more exactly (backlash), state the standard deviation of a "
            "coordinate with --point-std M"
        )
    return found


def _expected(estimated: Estimated) -> float:
    """m rms per coordinate of the held-out points, as the covariance of the estimate and the noise promise."""
    points = points_of(estimated.measured.held_out, thinned(estimated.measured.held_out, _PROMISED))
    model = np.trace(_promised(estimated.parameters, estimated.fit, points), axis1=1, axis2=2) / 3.0
    return float(np.sqrt(estimated.fit.noise**2 + np.mean(model)))


def _rows(one: LeftOut) -> str:
    listed = ", ".join(map(str, one.rows[:_LISTED])) + (" ..." if len(one.rows) > _LISTED else "")
    return f"{one.run} row{'s' if len(one.rows) > 1 else ''} {listed}"
