"""Recordings with a tracker -> kinematic parameters: the whole procedure, on runs of arrays.

1. an unknown tracker frame: the pose that best fits the points of the nominal arm to the measured ones;
2. circles of single-joint sweeps, and D-H from them: a second starting point besides the nominal, and the features
   themselves;
3. robust least squares on all points (``map_estimation``);
4. rows that belong to another trigger are found and realigned (``row_shifts``), and the fit repeated;
5. extensions - sag, encoder scale and ripple, coupling, delay - each tried on points that the fit has not seen
   (``cross_validation``);
6. a zero of its own for every run whose counters were set at its start (``run_zeros``);
7. the error on held-out runs, which took no part in any of this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array, Progress
from arm_model import Arm
from identification.kinematics.data.points import Points
from identification.kinematics.data.row_shifts import Shift, find_constant, find_step
from identification.kinematics.data.runs import Run, correlation_time, points_of, shifted, thinned, velocity_of
from identification.kinematics.estimation.circle_point import Circle
from identification.kinematics.estimation.cross_validation import PositionError, Trial, choose, position_error
from identification.kinematics.estimation.extensions import Extension, candidates, deflections, prior_scales
from identification.kinematics.estimation.map_estimation import Fit, fit, residuals
from identification.kinematics.estimation.observability import (
    RESTING,
    Observability,
    at_rest,
    identifiable,
    indices,
    scaled_jacobian,
)
from identification.kinematics.estimation.run_zeros import expected, with_own_zeros, with_zeros
from identification.kinematics.estimation.start import (
    best_circles,
    best_start,
    place_tracker,
    values_from_circles,
    with_nominal_target,
)
from identification.kinematics.models.chain import Chain, Gravity, Index, position
from identification.kinematics.models.parameters import Parameters, Trust, parameters_of

MOST = 10000
"""Points used for fitting; more are evenly thinned: neighbours at 1 kHz say the same thing."""


@dataclass(frozen=True)
class Calibration:
    """What was estimated, from which points, and how good it is.

    parameters, fit  what was free, and the estimate; ``chain`` is the calibrated chain
    extensions       joint extensions that were accepted, and all that were tried
    nominal          the chain before: nominal parameters, in the estimated tracker frame where that was unknown
    circles          features of single-joint sweeps; ``refused`` says why other sweeps gave none
    circle_point     position error on the fit points of D-H from the circles alone, or None
    before, after    position errors: {"fit": ..., "held_out": ...}
    std              standard deviation by parameter name, correlation of neighbouring points taken into account
    zero_error       m rms a coordinate: what the unknown zeros of the held-out runs' own encoders add to their error
    """

    parameters: Parameters
    fit: Fit
    extensions: tuple[Extension, ...]
    trials: tuple[Trial, ...]
    nominal: Chain
    circles: tuple[Circle, ...]
    refused: tuple[str, ...]
    circle_point: PositionError | None
    before: dict[str, PositionError]
    after: dict[str, PositionError]
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
    split: bool
    warnings: tuple[str, ...] = field(default=())

    @property
    def chain(self) -> Chain:
        """The chain at its estimated values."""
        return self.parameters.chain.at(self.fit.values)


@dataclass(frozen=True)
class Settings:
    """What is known beforehand, and what is tried.

    frame_known  whether positions are given in the base frame of the model
    trust        prior standard deviations
    gravity      joint torques that hold the arm, for sag; None: sag is not tried
    extend       whether sag, encoder errors, coupling and delay are tried
    """

    frame_known: bool
    trust: Trust = field(default_factory=Trust)
    gravity: Gravity | None = None
    extend: bool = True


@dataclass
class _Work:
    """A calibration in progress. rows: those of ``runs`` that ``points`` were taken from.

    Split: ``held_out`` are blocks of the same runs.
    """

    arm: Arm
    settings: Settings
    runs: list[Run]
    held_out: list[Run]
    split: bool
    rows: list[Index]
    points: Points
    parameters: Parameters
    nominal: Chain
    estimate: Fit
    tell: Progress
    extensions: list[Extension] = field(default_factory=list)
    trials: list[Trial] = field(default_factory=list)
    shifts: list[Shift] = field(default_factory=list)

    @property
    def moving(self) -> list[int]:
        """Joints (from 1) that move."""
        return [j + 1 for j in range(len(self.arm)) if np.ptp(self.points.q[:, j]) >= RESTING]


def calibrate(
    arm: Arm,
    runs: Sequence[Run],
    held_out: Sequence[Run],
    target: Sequence[float],
    settings: Settings,
    *,
    progress: Progress | None = None,
) -> Calibration:
    """The calibration of an arm from ``runs``.

    Judged on ``held_out`` (or, where there is none, on every fifth block of rows).

    target (3,) m: nominal place of the tracked target in the frame of the last link. InputError: not enough usable
    points, or joints that disagree with the model.
    """
    tell: Progress = progress or (lambda _: None)
    _check(arm, [*runs, *held_out])
    warnings: list[str] = []
    split = not held_out
    fitted, judged = _split(runs) if split else (list(runs), list(held_out))
    if split:
        warnings.append("no held-out recording: every fifth block of rows was held out instead, which flatters")
    rows = thinned(fitted, MOST)
    points = points_of(fitted, rows)
    frame_known, start = place_tracker(arm, points, target, settings.frame_known, warnings)
    settings = replace(settings, frame_known=frame_known)
    parameters = parameters_of(arm, target, frame_known=frame_known, trust=settings.trust)
    nominal = parameters.chain.at(start)
    tell("circles of single-joint sweeps")
    circles, refused = best_circles(fitted)
    from_circles = values_from_circles(arm, circles, nominal)
    tell("least squares on all points")
    estimate = _fit(parameters, points, best_start(parameters, points, start, from_circles))
    work = _Work(arm, settings, fitted, judged, split, rows, points, parameters, nominal, estimate, tell)
    _extend_and_realign(work)
    _estimate_run_zeros(work)
    circle_point = None
    if from_circles is not None:
        chain = parameters.chain.at(with_nominal_target(parameters, from_circles))
        circle_point = position_error(work.points.xyz - position(chain, work.points.q))
    return _result(work, circles, refused, circle_point, warnings)


def _extend_and_realign(work: _Work) -> None:
    """Extensions, then rows that belong to another trigger.

    Where there are such rows, the fit and the extensions once more.
    """
    if work.settings.extend:
        _extend(work)
    if _realign(work):
        work.rows = thinned(work.runs, MOST)
        work.points = points_of(work.runs, work.rows)
        work.estimate = _fit(work.parameters, work.points, work.estimate.values)
        if work.settings.extend:
            _extend(work)


def _estimate_run_zeros(work: _Work) -> None:
    """A zero of its own for every run whose counters were set at its start."""
    if all(run.count is None for run in work.runs):
        return
    work.tell("zeros of the encoders, run by run")
    gravity = work.settings.gravity
    work.points, work.estimate, zeros = with_own_zeros(
        work.parameters, work.runs, work.rows, work.estimate, work.extensions, gravity
    )
    work.runs = with_zeros(work.runs, zeros)
    work.held_out = with_zeros(work.held_out, zeros) if work.split else work.held_out


def _result(
    work: _Work,
    circles: Sequence[Circle],
    refused: Sequence[str],
    circle_point: PositionError | None,
    warnings: list[str],
) -> Calibration:
    parameters, estimate, points = work.parameters, work.estimate, work.points
    residual = residuals(parameters, estimate.values, estimate.extension, points)
    correlated = correlation_time(np.where(estimate.inlier[:, None], residual, 0.0), work.rows)
    deviation = np.sqrt(np.diag(estimate.covariance)) * np.sqrt(correlated)
    names = parameters.chain.names
    rank = identifiable(parameters, at_rest(points.q))
    warnings += _weaknesses(work, rank)
    columns = scaled_jacobian(parameters, points.q[:: max(1, len(points) // 2000)])
    errors = {"fit": _errors(work, work.runs), "held_out": _errors(work, work.held_out)}
    return Calibration(
        parameters=parameters,
        fit=estimate,
        extensions=tuple(work.extensions),
        trials=tuple(work.trials),
        nominal=work.nominal,
        circles=tuple(circles),
        refused=tuple(refused),
        circle_point=circle_point,
        before={part: before for part, (before, _) in errors.items()},
        after={part: after for part, (_, after) in errors.items()},
        std={names[k]: float(deviation[i]) for i, k in enumerate(parameters.free)},
        extension_std=deviation[len(parameters.free) :],
        identifiable=rank,
        observability=indices(columns.reshape(-1, columns.shape[2]), min(rank, columns.shape[2]), len(columns)),
        shifts=tuple(work.shifts),
        correlated=correlated,
        zero_error=0.0 if work.split else expected(parameters.chain.at(estimate.values), work.held_out),
        frame_known=work.settings.frame_known,
        runs=tuple(work.runs),
        held_out=tuple(work.held_out),
        split=work.split,
        warnings=tuple(warnings),
    )


def _weaknesses(work: _Work, rank: int) -> list[str]:
    """Warnings: parameters that the poses do not determine, and many outliers."""
    found = []
    moving = work.moving
    prismatic = sum(not work.arm.joints[j - 1].revolute for j in moving)
    if rank < len(moving) * 4 + 3 - 2 * prismatic:
        found.append(
            f"{rank} of {4 * len(moving) + 3} parameters are identifiable from these poses; record more varied poses"
        )
    share = 1.0 - float(np.mean(work.estimate.inlier))
    if share > 0.1:
        found.append(
            f"{100 * share:.0f} % of the points were left out as outliers: something the model lacks, or a bad tracker"
        )
    return found


def predicted(calibration: Calibration, run: Run, gravity: Gravity | None, *, before: bool = False) -> Array:
    """Positions (N, 3) m of the target over a run, by the calibrated or (``before``) the nominal arm.

    NaN where q is missing.
    """
    q = np.nan_to_num(run.q)
    if before:
        at = position(calibration.nominal, q)
    else:
        bend = deflections(calibration.extensions, q, velocity=run.velocity(), gravity=gravity)
        at = position(calibration.chain, Points(q, run.xyz, bend).bent(calibration.fit.extension))
    at[~np.isfinite(run.q).all(axis=1)] = np.nan
    return at


def _check(arm: Arm, runs: Sequence[Run]) -> None:
    for run in runs:
        if run.q.shape[1] != len(arm):
            raise InputError(run.name, f"has {run.q.shape[1]} joints, the model has {len(arm)}")
        usable = int(run.usable.sum())
        if usable < 10:
            raise InputError(
                run.name, f"{usable} rows have all joint angles and a tracked point; at least 10 are needed"
            )
        if not np.any(np.ptp(run.q[run.usable], axis=0) >= RESTING):
            raise InputError(run.name, "no joint moves; a calibration needs the target tracked while the joints move")


def _split(runs: Sequence[Run]) -> tuple[list[Run], list[Run]]:
    """Every run in blocks of a fiftieth of its rows, every fifth held out.

    The points of the others are NaN in each half.
    """
    kept, left = [], []
    for run in runs:
        block = np.arange(len(run.t)) * 50 // max(len(run.t), 1) if len(run.t) >= 250 else np.arange(len(run.t))
        out = (block % 5 == 2)[:, None]
        kept.append(replace(run, xyz=np.where(out, np.nan, run.xyz)))
        left.append(replace(run, xyz=np.where(out, run.xyz, np.nan)))
    return kept, left


def _fit(parameters: Parameters, points: Points, start: Array) -> Fit:
    return fit(parameters, Points(points.q, points.xyz), start=start)


def _extend(work: _Work) -> None:
    """Selects the extensions that improve the error on points that the fit has not seen, and fits them."""
    points, velocity = points_of(work.runs, work.rows), velocity_of(work.runs, work.rows)
    gravity = work.settings.gravity
    prismatic = [not j.revolute for j in work.arm.joints]
    tried = candidates(work.moving, prismatic, gravity=gravity is not None, velocity=_moves(velocity))

    def deflect(extensions: Sequence[Extension]) -> Array:
        return deflections(extensions, points.q, velocity=velocity, gravity=gravity)

    blocks = _blocks(work.runs, work.rows)
    work.extensions, work.trials = choose(
        work.parameters, points, blocks, tried, deflect, work.estimate, report=work.tell
    )
    if work.extensions:
        points = Points(points.q, points.xyz, deflect(work.extensions))
        scale = prior_scales(work.extensions)
        work.estimate = fit(work.parameters, points, start=work.estimate.values, extension_scale=scale)
    work.points = points


def _realign(work: _Work) -> bool:
    """Moves points back to their own rows where the delay steps within a run, or is a whole number of rows throughout.

    Whether any was.

    Blocks of one run, some held out, are moved alike: as the fitted half of the run shows.
    """
    chain, extension = work.parameters.chain.at(work.estimate.values), work.estimate.extension
    still = [0.0 if e.definition.late is not None else 1.0 for e in work.extensions for _ in e.parameters]

    def bent(run: Run) -> Run:
        bend = deflections(work.extensions, np.nan_to_num(run.q), velocity=None, gravity=work.settings.gravity)
        return replace(run, q=run.q + bend @ (extension * still))

    def aligned_rows(run: Run) -> tuple[Run, list[Shift]]:
        mine: list[Shift] = []
        for search in (find_step, find_step, find_step, find_constant):
            shift = search(bent(run), chain, work.estimate.noise)
            if shift is not None:
                mine.append(shift)
                run = shifted(run, shift.first, shift.rows)
        return run, mine

    for k, run in enumerate(work.runs):
        work.runs[k], mine = aligned_rows(run)
        work.shifts += mine
        for shift in mine if work.split else []:
            work.held_out[k] = shifted(work.held_out[k], shift.first, shift.rows)
    if not work.split:
        for k, run in enumerate(work.held_out):
            work.held_out[k], mine = aligned_rows(run)
            work.shifts += mine
    return bool(work.shifts)


def _moves(velocity: Array) -> bool:
    return bool(np.abs(velocity).max(initial=0.0) > 0.01)


def _blocks(runs: Sequence[Run], rows: Sequence[Index]) -> Index:
    """Block number of every point: a second each, or a fiftieth of a run where rows are few (poses, one row each)."""
    numbers: list[Index] = []
    offset = 0
    for run, which in zip(runs, rows, strict=True):
        t = run.t[which]
        block = np.floor(t - t[0]).astype(int) if len(which) else np.zeros(0, int)
        count = len(np.unique(block))
        if count < 8 or count > len(which) / 3:
            block = np.arange(len(which)) * min(50, len(which)) // max(len(which), 1)
        numbers.append(block + offset)
        offset += (int(block.max()) + 1) if len(block) else 0
    return np.concatenate(numbers)


def _errors(work: _Work, runs: Sequence[Run]) -> tuple[PositionError, PositionError]:
    """Position error before and after, over all usable points of some runs (at most 100000)."""
    rows = thinned(runs, 100_000)
    points = points_of(runs, rows)
    bend = deflections(work.extensions, points.q, velocity=velocity_of(runs, rows), gravity=work.settings.gravity)
    points = Points(points.q, points.xyz, bend)
    after = residuals(work.parameters, work.estimate.values, work.estimate.extension, points)
    kept = position_error(after)
    inside = np.linalg.norm(after, axis=1) <= max(kept.largest, 0.0)
    return position_error((points.xyz - position(work.nominal, points.q))[inside], reject=False), kept
