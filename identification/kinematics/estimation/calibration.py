"""Recordings with a tracker -> kinematic parameters: the whole procedure, on runs of arrays.

1. an unknown tracker frame: the pose that best fits the points of the nominal arm to the measured ones;
2. circles of single-joint sweeps, and D-H from them: a second starting point besides the nominal, and the features
   themselves;
3. robust least squares on all points (``map_estimation``);
4. where points do not fit, couplings and ratios of joints (``coupled_joints``), before any are left out for good; a
   target that was given too confidently is estimated (``given_targets``);
5. rows that belong to another trigger are found and realigned (``row_shifts``), and the fit repeated;
6. extensions - sag, encoder scale and ripple, coupling, delay - each tried on points that the fit has not seen
   (``cross_validation``);
7. a zero of its own for every run whose counters were set at its start (``run_zeros``);
8. the error on all held-out points, which took no part in any of this (``judgement``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io import InputError, counted
from arm_io.types import Array, Progress
from arm_model import Arm, Coupling
from arm_model.tables import Uncertainty, uncertainty_of
from identification.kinematics.circle_points.circle_point import Circle
from identification.kinematics.data.blocks import split
from identification.kinematics.data.measured import JudgedBy, Measured, linked
from identification.kinematics.data.row_shifts import Shift
from identification.kinematics.data.runs import Run, correlation_in_poses, correlation_time, poses_of
from identification.kinematics.estimation.coupled_joints import with_couplings
from identification.kinematics.estimation.cross_validation import Trial
from identification.kinematics.estimation.estimated import Estimated, Settings
from identification.kinematics.estimation.extended_fit import extended, with_run_zeros
from identification.kinematics.estimation.extensions import Extension
from identification.kinematics.estimation.given_targets import with_free_targets
from identification.kinematics.estimation.judgement import best_frame_and_target, judged, weaknesses
from identification.kinematics.estimation.map_estimation import Fit, residuals
from identification.kinematics.estimation.observability import (
    RESTING,
    Observability,
    identifiable,
    indices,
    scaled_jacobian,
)
from identification.kinematics.estimation.observed import residual_of
from identification.kinematics.estimation.position_error import LeftOut, PositionError, position_error
from identification.kinematics.estimation.run_zeros import expected
from identification.kinematics.estimation.start import first_fit, with_nominal_target
from identification.kinematics.models.chain import Chain
from identification.kinematics.models.parameters import Parameters, Target

LEAST = 10
"""Poses: fewer determine nothing, and judge nothing."""
FILE = "model_kinematic_uncertainty.json"
FEW = 500
"""Points of all runs, below which they are cross-validated: a fifth of them would judge too little."""


@dataclass(frozen=True)
class Calibration:
    """What was estimated, from which points, and how good it is.

    parameters, fit  what was free, and the estimate; ``chain`` is the calibrated chain
    coupling         (n, n): link angles = coupling times reported angles; ``couplings`` as a model file has them, their
                     standard deviations beside them
    extensions       joint extensions that were accepted, and all that were tried
    nominal          the chain before: nominal parameters, after the best fit of frame and target
    circles          features of single-joint sweeps; ``refused`` says why other sweeps gave none
    circle_point     position error on the fit points of D-H from the circles alone, or None, and then
                     ``without_circles`` says why
    before, after    position errors: {"fit": ..., "held_out": ...}, over all points
    left_out         the points that the model does not fit, by run and row
    failures         why no success may be claimed; empty: it may
    std              standard deviation by parameter name, correlation of neighbouring points taken into account
    zero_error       m rms a coordinate: what the unknown zeros of the held-out runs' own encoders add to their error
    runs, held_out   with the angles of the links
    targets          what was tracked, those that were given wrongly as free; ``aims``: (3, 3) by target with
                     orientations, by which measured ones were turned (R X'); ``last_link``: (4, 4) pose of the last
                     link of the user's model in that of the chain
    orientation      rms rad, {"fit": {"before", "after"}, "held_out": ...}; {} without orientations
    """

    parameters: Parameters
    fit: Fit
    coupling: Array
    couplings: tuple[tuple[Coupling, float], ...]
    nominal_coupling: Array
    extensions: tuple[Extension, ...]
    trials: tuple[Trial, ...]
    nominal: Chain
    circles: tuple[Circle, ...]
    refused: tuple[str, ...]
    circle_point: PositionError | None
    without_circles: str
    before: dict[str, PositionError]
    after: dict[str, PositionError]
    left_out: tuple[LeftOut, ...]
    failures: tuple[str, ...]
    std: dict[str, float]
    extension_std: Array
    identifiable: int
    observability: Observability
    shifts: tuple[Shift, ...]
    correlated: float
    zero_error: float
    frame_known: bool
    runs: tuple[Run, ...]
    held_out: tuple[Run, ...]
    judged_by: JudgedBy
    targets: tuple[Target, ...]
    aims: Mapping[int, Array]
    last_link: Array
    orientation: dict[str, dict[str, float]]
    warnings: tuple[str, ...] = field(default=())

    @property
    def known(self) -> Uncertainty:
        """Covariance of the geometry of the arm that is written, whatever target, tracker frame and effects are.

        rad and m; of the base only where the tracker's frame is known: elsewhere it stays the model's.
        """
        names = [self.parameters.chain.names[k] for k in self.parameters.free]
        ours = [
            i
            for i, name in enumerate(names)
            if name.startswith("joint") or (name.startswith("base.") and self.frame_known)
        ]
        covariance = self.fit.covariance[np.ix_(ours, ours)] * self.correlated
        return uncertainty_of(FILE, tuple(names[i] for i in ours), covariance)

    @property
    def chain(self) -> Chain:
        """The chain at its estimated values."""
        return self.parameters.chain.at(self.fit.values)


def calibrate(
    arm: Arm,
    runs: Sequence[Run],
    held_out: Sequence[Run],
    targets: Sequence[Target],
    settings: Settings,
    *,
    progress: Progress | None = None,
) -> Calibration:
    """The calibration of an arm from ``runs``.

    Judged on ``held_out``; where there is none, on every fifth block of rows, or by cross-validation where points are
    few (also where fewer than ``LEAST`` poses were held out: they are then pooled with the others).

    targets: what was tracked; ``Run.target`` counts through them. InputError: not enough usable points, or joints that
    disagree with the model.
    """
    progress = progress or (lambda _: None)
    measured = _measured(arm, runs, held_out, settings)
    found = first_fit(arm, measured, targets, settings, progress)
    found = with_couplings(found, progress)
    found = with_free_targets(found)
    found = extended(found, progress)
    found = with_run_zeros(found, progress)
    return _result(found)


def _measured(arm: Arm, runs: Sequence[Run], held_out: Sequence[Run], settings: Settings) -> Measured:
    """The runs, with the link angles of the nominal model, and what judges them."""
    _check(arm, runs, least=LEAST)
    _check(arm, held_out, least=1)
    warnings = []
    few = 0 < poses_of(held_out) < LEAST
    if few:
        runs, held_out = [*runs, *held_out], []
        warnings.append(f"fewer than {LEAST} poses were held out: they were pooled with the others")
    matrix = arm.coupling_matrix
    fitted, rest = ([replace(linked(run, matrix), std=settings.point_std) for run in side] for side in (runs, held_out))
    judged_by: JudgedBy = "held_out"
    if not rest and (few or poses_of(fitted) < FEW):
        judged_by, rest = "cross-validation", fitted
        warnings.append("no held-out poses: each is predicted without the tenth of all poses that it belongs to")
    elif not rest:
        judged_by, (fitted, rest) = "split", split(fitted)
        warnings.append("no held-out recording: every fifth block of rows was held out instead, an optimistic test")
    return Measured(
        runs=tuple(fitted),
        held_out=tuple(rest),
        judged_by=judged_by,
        coupling=matrix,
        warnings=tuple(warnings),
    )


def _result(estimated: Estimated) -> Calibration:
    parameters, found, measured, points = estimated.parameters, estimated.fit, estimated.measured, estimated.points
    residual = residuals(parameters, found.values, found.extension, points)
    kept = np.where((found.inlier & ~points.oriented)[:, None], residual, 0.0)
    correlated = correlation_time(kept, measured.rows) * correlation_in_poses(kept, measured.runs, measured.rows)
    deviation = np.sqrt(np.diag(found.covariance)) * np.sqrt(correlated)
    names = parameters.chain.names
    here = replace(parameters, chain=estimated.chain)
    rank = identifiable(here, points.deflected(None))
    columns = scaled_jacobian(here, points.where(slice(None, None, max(1, len(points) // 2000))))
    nominal = best_frame_and_target(estimated)
    judgement = judged(estimated, nominal)
    return Calibration(
        parameters=parameters,
        fit=found,
        coupling=measured.coupling,
        couplings=_couplings(estimated),
        nominal_coupling=estimated.arm.coupling_matrix,
        extensions=estimated.extensions,
        trials=estimated.trials,
        nominal=nominal,
        circles=estimated.circles.circles,
        refused=estimated.circles.refused,
        circle_point=_circle_point(estimated),
        without_circles=estimated.circles.why_not,
        before=judgement.before,
        after=judgement.after,
        left_out=judgement.left_out,
        failures=judgement.failures,
        std={names[k]: float(deviation[i]) for i, k in enumerate(parameters.free)},
        extension_std=deviation[len(parameters.free) :],
        identifiable=rank,
        observability=indices(columns.reshape(-1, columns.shape[2]), min(rank, columns.shape[2]), len(columns)),
        shifts=measured.shifts,
        correlated=correlated,
        zero_error=expected(here.chain, measured.held_out) if measured.judged_by == "held_out" else 0.0,
        frame_known=estimated.frame_known,
        runs=measured.runs,
        held_out=measured.held_out,
        judged_by=measured.judged_by,
        targets=estimated.targets,
        aims=measured.aims,
        last_link=estimated.settings.last_link,
        orientation=judgement.orientation,
        warnings=(*measured.warnings, *estimated.warnings, *judgement.warnings, *weaknesses(estimated, rank)),
    )


def _couplings(estimated: Estimated) -> tuple[tuple[Coupling, float], ...]:
    """Entries that differ from the identity, and their standard deviations (0: held, or an integer)."""
    matrix, std = estimated.measured.coupling, estimated.coupling_std
    different = np.argwhere(np.abs(matrix - np.eye(len(matrix))) > 1e-12)
    return tuple(
        (Coupling(int(j) + 1, int(k) + 1, float(matrix[j, k])), std.get((int(j), int(k)), 0.0)) for j, k in different
    )


def _circle_point(estimated: Estimated) -> PositionError | None:
    circles, points = estimated.circles, estimated.points
    if circles.values is None or circles.why_not:
        return None
    chain = estimated.parameters.chain.at(with_nominal_target(estimated.parameters, circles.values))
    first = ~points.oriented & (True if points.target is None else points.target == 0)
    return position_error(residual_of(chain, points.where(first).deflected(None)))


def _check(arm: Arm, runs: Sequence[Run], least: int) -> None:
    for run in runs:
        if run.q.shape[1] != len(arm):
            raise InputError(run.name, f"has {counted(run.q.shape[1], 'joint')}, the model has {len(arm)}")
    if not runs:
        return
    where = ", ".join(dict.fromkeys(run.source for run in runs))
    poses = poses_of([run for run in runs if not run.lever])
    if poses < least:
        raise InputError(
            where,
            f"{poses} {'row has' if poses == 1 else 'rows have'} all joint angles and a tracked point; at least "
            f"{least} {'is' if least == 1 else 'are'} needed",
        )
    for run in runs:
        if not run.usable.any():
            raise InputError(run.name, "no row has all joint angles and its point; leave out targets never seen")
    q = np.concatenate([run.q[run.usable] for run in runs])
    if least > 1 and not np.any(np.ptp(q, axis=0) >= RESTING):
        raise InputError(where, "no joint moves; a calibration needs the target tracked while the joints move")
