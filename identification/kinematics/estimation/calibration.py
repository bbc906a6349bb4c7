"""Recordings with a tracker -> kinematic parameters: the whole procedure, on runs of arrays.

1. an unknown tracker frame: the nominal arm's points laid onto the measured ones;
2. circles of single-joint sweeps, and D-H from them: a second starting point beside the nominal, and the features themselves;
3. robust least squares on all points (``least_squares``);
4. rows that belong to another trigger are found and put back (``shifts``), and the fit repeated;
5. extensions - sag, encoder scale and ripple, coupling, delay - each tried on points the fit has not seen (``judging``);
6. a zero of its own for every run whose counters were set at its start (``encoder_steps``);
7. the error on held-out runs, which took no part in any of this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array, Progress
from arm_model.description import Arm
from identification.kinematics.data.points import Points
from identification.kinematics.data.row_shifts import Shift, find_constant, find_step
from identification.kinematics.data.runs import Run, aligned, correlation_time, points_of, shifted, thinned, velocity_of
from identification.kinematics.estimation.axes import circle_point_model
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
from identification.kinematics.estimation.sweeps import circles_of
from identification.kinematics.models.chain import Chain, Gravity, Index, position, xyz_ypr
from identification.kinematics.models.parameters import Parameters, Trust, base_pose, parameters_of

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


def calibrate(
    arm: Arm,
    runs: Sequence[Run],
    held_out: Sequence[Run],
    target: Sequence[float],
    *,
    frame_known: bool,
    trust: Trust | None = None,
    gravity: Gravity | None = None,
    extend: bool = True,
    progress: Progress | None = None,
) -> Calibration:
    """The calibration of an arm from ``runs``, judged on ``held_out`` (or, where there is none, on every fifth block of rows).

    target (3,) m: nominal place of the tracked target in the frame of the last link. gravity: joint torques that hold the arm, for
    sag; without it sag is not tried. InputError: not enough usable points, or joints that disagree with the model.
    """
    tell: Progress = progress or (lambda _: None)
    runs, held_out = list(runs), list(held_out)
    _check(arm, [*runs, *held_out])
    warnings: list[str] = []
    split = not held_out
    if split:
        runs, held_out = _split(runs)
        warnings.append("no held-out recording: every fifth block of rows was held out instead, which flatters")
    rows = thinned(runs, MOST)
    points = points_of(runs, rows)
    frame_known, start = _place(arm, points, target, frame_known, warnings)
    parameters = parameters_of(arm, target, frame_known=frame_known, trust=trust or Trust())
    nominal = parameters.chain.at(start)

    tell("circles of single-joint sweeps")
    circles, refused = _circles(runs)
    circle_values = _from_circles(arm, circles, nominal)
    tell("least squares on all points")
    estimate = _fit(parameters, points, _best_start(parameters, points, start, circle_values))
    moving = [j + 1 for j in range(len(arm)) if np.ptp(points.q[:, j]) >= RESTING]
    chosen: list[Extension] = []
    trials: list[Trial] = []
    shifts: list[Shift] = []
    for attempt in range(2):
        if extend:
            points, estimate, chosen, trials = _extended(arm, parameters, runs, rows, estimate, moving, gravity, tell)
        if attempt:
            break
        runs, held_out, shifts = _put_right(
            runs, held_out, parameters.chain.at(estimate.values), estimate, chosen, gravity, split
        )
        if not shifts:
            break
        rows = thinned(runs, MOST)
        points = points_of(runs, rows)
        estimate = _fit(parameters, points, estimate.values)

    if any(run.count is not None for run in runs):
        tell("zeros of the encoders, run by run")
        points, estimate, zeros = with_own_zeros(parameters, runs, rows, estimate, chosen, gravity)
        runs = with_zeros(runs, zeros)
        held_out = with_zeros(held_out, zeros) if split else held_out
    residual = residuals(parameters, estimate.values, estimate.extension, points)
    correlated = correlation_time(np.where(estimate.inlier[:, None], residual, 0.0), rows)
    deviation = np.sqrt(np.diag(estimate.covariance)) * np.sqrt(correlated)
    names = parameters.chain.names
    rank = identifiable(parameters, at_rest(points.q))
    if rank < len(moving) * 4 + 3 - 2 * sum(not arm.joints[j - 1].revolute for j in moving):
        warnings.append(
            f"{rank} of {4 * len(moving) + 3} parameters are identifiable from these poses; more varied poses are wanted"
        )
    share = 1.0 - float(np.mean(estimate.inlier))
    if share > 0.1:
        warnings.append(
            f"{100 * share:.0f} % of the points were left out as outliers: something the model lacks, or a bad tracker"
        )
    columns = scaled_jacobian(parameters, points.q[:: max(1, len(points) // 2000)])
    errors = [_errors(parameters, nominal, estimate, chosen, part, gravity) for part in (runs, held_out)]
    return Calibration(
        parameters=parameters,
        fit=estimate,
        extensions=tuple(chosen),
        trials=tuple(trials),
        nominal=nominal,
        circles=tuple(circles),
        refused=tuple(refused),
        circle_point=None
        if circle_values is None
        else position_error(
            points.xyz - position(parameters.chain.at(_with_target(parameters, circle_values)), points.q)
        ),
        before={"fit": errors[0][0], "held_out": errors[1][0]},
        after={"fit": errors[0][1], "held_out": errors[1][1]},
        std={names[k]: float(deviation[i]) for i, k in enumerate(parameters.free)},
        extension_std=deviation[len(parameters.free) :],
        identifiable=rank,
        observability=indices(columns.reshape(-1, columns.shape[2]), min(rank, columns.shape[2]), len(columns)),
        shifts=tuple(shifts),
        correlated=correlated,
        zero_error=0.0 if split else expected(parameters.chain.at(estimate.values), held_out),
        frame_known=frame_known,
        runs=tuple(runs),
        held_out=tuple(held_out),
        split=split,
        warnings=tuple(warnings),
    )


def predicted(calibration: Calibration, run: Run, gravity: Gravity | None, *, before: bool = False) -> Array:
    """Positions (N, 3) m of the target over a run, by the calibrated or (``before``) the nominal arm; NaN where q is missing."""
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
                run.name, f"{usable} rows have all joint angles and a tracked point; at least 10 are wanted"
            )
        if not np.any(np.ptp(run.q[run.usable], axis=0) >= RESTING):
            raise InputError(run.name, "no joint moves; a calibration wants the target tracked while the joints move")


def _split(runs: Sequence[Run]) -> tuple[list[Run], list[Run]]:
    """Every run in blocks of a fiftieth of its rows, every fifth held out: the points of the others are NaN in each half."""
    kept, left = [], []
    for run in runs:
        block = np.arange(len(run.t)) * 50 // max(len(run.t), 1) if len(run.t) >= 250 else np.arange(len(run.t))
        out = (block % 5 == 2)[:, None]
        kept.append(replace(run, xyz=np.where(out, np.nan, run.xyz)))
        left.append(replace(run, xyz=np.where(out, run.xyz, np.nan)))
    return kept, left


def _place(
    arm: Arm, points: Points, target: Sequence[float], frame_known: bool, warnings: list[str]
) -> tuple[bool, Array]:
    """Whether the tracker's frame can be taken as known, and the chain's values to begin from."""
    parameters = parameters_of(arm, target, frame_known=frame_known, trust=Trust())
    chain = parameters.chain
    at = position(chain, points.q)
    pose = aligned(at, points.xyz)
    as_given = float(np.median(np.linalg.norm(points.xyz - at, axis=1)))
    laid_over = float(np.median(np.linalg.norm(points.xyz - at @ pose[:3, :3].T - pose[:3, 3], axis=1)))
    if frame_known and as_given > 0.1 and laid_over < as_given / 4:
        frame_known = False
        warnings.append(
            f"the points are {1e3 * as_given:.0f} mm off the model in the stated tracker frame and {1e3 * laid_over:.1f} mm once laid "
            "over it: the frame was taken as unknown and estimated"
        )
    if frame_known:
        return True, chain.values
    correction = np.linalg.inv(np.array(arm.base)) @ pose @ base_pose(chain)
    place = dict(zip(("x", "y", "z", "yaw", "pitch", "roll"), xyz_ypr(correction), strict=True))
    values = [place[s.name[5:]] if s.name.startswith("base.") else s.value for s in chain.steps]
    return False, np.array(values)


def _circles(runs: Sequence[Run]) -> tuple[list[Circle], list[str]]:
    best: dict[int, Circle] = {}
    refused: list[str] = []
    for run in runs:
        found, reasons = circles_of(run.q, run.xyz)
        refused += [f"{run.name}: {reason}" for reason in reasons]
        for circle in found:
            if circle.joint not in best or circle.std_centre < best[circle.joint].std_centre:
                best[circle.joint] = circle
    return [best[j] for j in sorted(best, reverse=True)], refused


def _from_circles(arm: Arm, circles: Sequence[Circle], nominal: Chain) -> Array | None:
    if not circles or any(j.convention != "standard" for j in arm.joints):
        return None
    return circle_point_model(circles, nominal)


def _with_target(parameters: Parameters, values: Array) -> Array:
    """Circle-point analysis alone takes the target to be where it should be."""
    values, nominal = values.copy(), parameters.chain.values
    for k, name in enumerate(parameters.chain.names):
        if name.startswith("target."):
            values[k] = nominal[k]
    return values


def _best_start(parameters: Parameters, points: Points, nominal: Array, circles: Array | None) -> Array:
    starts = [nominal] if circles is None else [nominal, _with_target(parameters, circles)]
    off = [
        float(np.median(np.linalg.norm(residuals(parameters, s, np.zeros(0), Points(points.q, points.xyz)), axis=1)))
        for s in starts
    ]
    return starts[int(np.argmin(off))]


def _fit(parameters: Parameters, points: Points, start: Array) -> Fit:
    return fit(parameters, Points(points.q, points.xyz), start=start)


def _extended(
    arm: Arm,
    parameters: Parameters,
    runs: Sequence[Run],
    rows: Sequence[Index],
    estimate: Fit,
    moving: Sequence[int],
    gravity: Gravity | None,
    tell: Progress,
) -> tuple[Points, Fit, list[Extension], list[Trial]]:
    """The fit with those extensions that earn their place."""
    points, velocity = points_of(runs, rows), velocity_of(runs, rows)
    tried = candidates(
        moving, [not j.revolute for j in arm.joints], gravity=gravity is not None, velocity=_moves(velocity)
    )

    def deflect(extensions: Sequence[Extension]) -> Array:
        return deflections(extensions, points.q, velocity=velocity, gravity=gravity)

    chosen, trials = choose(parameters, points, _blocks(runs, rows), tried, deflect, estimate, report=tell)
    if chosen:
        points = Points(points.q, points.xyz, deflect(chosen))
        estimate = fit(parameters, points, start=estimate.values, extension_scale=prior_scales(chosen))
    return points, estimate, chosen, trials


def _put_right(
    runs: list[Run],
    held_out: list[Run],
    chain: Chain,
    estimate: Fit,
    chosen: Sequence[Extension],
    gravity: Gravity | None,
    split: bool,
) -> tuple[list[Run], list[Run], list[Shift]]:
    """Points moved back to their own rows where the delay steps within a run, or is a whole number of rows all along.

    Blocks of one run, some held out, are moved alike: as the fitted half of the run shows.
    """
    found: list[Shift] = []
    still = [0.0 if e.definition.late is not None else 1.0 for e in chosen for _ in e.parameters]

    def bent(run: Run) -> Run:
        bend = deflections(chosen, np.nan_to_num(run.q), velocity=None, gravity=gravity)
        return replace(run, q=run.q + bend @ (estimate.extension * still))

    def right(run: Run) -> tuple[Run, list[Shift]]:
        mine: list[Shift] = []
        for search in (find_step, find_step, find_step, find_constant):
            shift = search(bent(run), chain, estimate.noise)
            if shift is not None:
                mine.append(shift)
                run = shifted(run, shift.first, shift.rows)
        return run, mine

    for k, run in enumerate(runs):
        runs[k], mine = right(run)
        found += mine
        for shift in mine if split else []:
            held_out[k] = shifted(held_out[k], shift.first, shift.rows)
    if not split:
        for k, run in enumerate(held_out):
            held_out[k], mine = right(run)
            found += mine
    return runs, held_out, found


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


def _errors(
    parameters: Parameters,
    nominal: Chain,
    estimate: Fit,
    chosen: Sequence[Extension],
    runs: Sequence[Run],
    gravity: Gravity | None,
) -> tuple[PositionError, PositionError]:
    """Position error before and after, over all usable points of some runs (at most 100000)."""
    rows = thinned(runs, 100_000)
    points = points_of(runs, rows)
    bend = deflections(chosen, points.q, velocity=velocity_of(runs, rows), gravity=gravity)
    points = Points(points.q, points.xyz, bend)
    after = residuals(parameters, estimate.values, estimate.extension, points)
    kept = position_error(after)
    inside = np.linalg.norm(after, axis=1) <= max(kept.largest, 0.0)
    return position_error((points.xyz - position(nominal, points.q))[inside], reject=False), kept
