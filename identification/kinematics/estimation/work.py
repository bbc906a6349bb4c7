"""A calibration in progress, and its first steps: a fit of all points, couplings of joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm
from identification.kinematics.circle_points.circle_point import Circle
from identification.kinematics.data.blocks import blocks
from identification.kinematics.data.points import Points
from identification.kinematics.data.recordings import Gravity
from identification.kinematics.data.row_shifts import Shift
from identification.kinematics.data.runs import Run, points_of, thinned
from identification.kinematics.estimation.coupled_joints import Entry, entry_columns, find_couplings, refined
from identification.kinematics.estimation.cross_validation import Trial
from identification.kinematics.estimation.extensions import Extension
from identification.kinematics.estimation.map_estimation import Fit, fit, residuals
from identification.kinematics.estimation.observability import RESTING
from identification.kinematics.estimation.orientation import aimed, lever_of, realigned
from identification.kinematics.estimation.outlier_pattern import shared
from identification.kinematics.estimation.start import (
    best_circles,
    best_start,
    place_tracker,
    values_from_circles,
    why_no_circles,
)
from identification.kinematics.models.chain import Chain, Index, Mask
from identification.kinematics.models.parameters import (
    Parameters,
    Target,
    Trust,
    parameters_of,
)

MOST = 10000
"""Points used for fitting; more are evenly thinned: neighbours at 1 kHz say the same thing."""
IMPOSSIBLE_NOISE = 1e-3
"""m per coordinate: no tracker of points is worse."""
_MORE = 1.5
"""Noise over the stated one that a coarse statement allows."""
OUTLIERS = 0.05
"""Share of the points left out, above which the model is at fault and not the points."""
_FEW = 1000
"""Points of poses measured one by one, each of which counts."""
JudgedBy = Literal["held_out", "split", "cross-validation"]


@dataclass(frozen=True)
class Settings:
    """What is known beforehand, and what is tried.

    frame_known  whether positions are given in the base frame of the model
    trust        prior standard deviations
    gravity      joint torques that hold the arm, for sag; None: sag is not tried
    extend       whether couplings, sag, encoder errors and delay are tried
    point_std    m, stated standard deviation of a coordinate of a point: of the tracker, and of an arm that does not
                 return to a pose exactly; 0: estimated
    last_link    (4, 4) pose of the last link of the user's model in the last link of the arm, for messages
    """

    frame_known: bool
    trust: Trust = field(default_factory=Trust)
    gravity: Gravity | None = None
    extend: bool = True
    point_std: float = 0.0
    last_link: Array = field(default_factory=lambda: np.eye(4))

    @property
    def most_noise(self) -> float:
        """m per coordinate: what is left above it is the model's error."""
        return max(IMPOSSIBLE_NOISE, _MORE * self.point_std)


@dataclass
class Work:
    """A calibration in progress. rows: those of ``runs`` that ``points`` were taken from.

    runs, held_out  with link angles q; link angles = ``coupling`` (n, n) times reported ones
    judged_by       "split": ``held_out`` are blocks of the same runs; "cross-validation": they are the same runs
    first           where the estimation began, in the estimated tracker frame if that was unknown
    aims            (3, 3) by target: the frame that its measured orientations are of now, in which they were given
    """

    arm: Arm
    settings: Settings
    targets: Sequence[Target]
    runs: list[Run]
    held_out: list[Run]
    judged_by: JudgedBy
    tell: Progress
    coupling: Array
    rows: list[Index] = field(init=False)
    points: Points = field(init=False)
    parameters: Parameters = field(init=False)
    first: Chain = field(init=False)
    estimate: Fit = field(init=False)
    circles: list[Circle] = field(init=False)
    refused: list[str] = field(init=False)
    from_circles: Array | None = field(init=False)
    without_circles: str = ""
    coupling_std: dict[Entry, float] = field(default_factory=dict)
    extensions: list[Extension] = field(default_factory=list)
    trials: list[Trial] = field(default_factory=list)
    shifts: list[Shift] = field(default_factory=list)
    moved_frame: str = ""
    aims: dict[int, Array] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    @property
    def moving(self) -> list[int]:
        """Joints (from 1) that move."""
        return [j + 1 for j in range(len(self.arm)) if np.ptp(self.points.q[:, j]) >= RESTING]


def first_fit(work: Work) -> None:
    """The pose of the tracker, circles of sweeps, and least squares on all points."""
    work.rows = thinned(work.runs, MOST)
    work.points = points_of(work.runs, work.rows)
    found: list[str] = []
    known, start = place_tracker(work.arm, work.points, work.targets, work.settings.frame_known, found)
    work.moved_frame = "".join(found)
    work.warnings += found
    work.settings = replace(work.settings, frame_known=known)
    work.parameters = parameters_of(work.arm, work.targets, frame_known=known, trust=work.settings.trust)
    work.first = work.parameters.chain.at(start)
    align_orientations(work)
    work.tell("circles of single-joint sweeps")
    work.circles, work.refused = best_circles(work.runs)
    work.from_circles = values_from_circles(work.arm, work.circles, work.first)
    work.without_circles = why_no_circles(work.arm, work.targets[0], work.runs, work.refused, found=bool(work.circles))
    work.tell("least squares on all points")
    best = best_start(work.parameters, work.points, start, work.from_circles)
    work.estimate = fit(work.parameters, work.points, start=best)
    if weigh_orientations(work):
        work.estimate = fit(work.parameters, work.points, start=work.estimate.values)


def couple(work: Work, stated_frame: bool) -> None:
    """Couplings of joints, where points do not fit: found, and the first fit repeated with them.

    stated_frame: whether the tracker's frame was stated as known, which wrong angles may have refuted.
    """
    contested = stated_frame and not work.settings.frame_known
    if not work.settings.extend or not (contested or _doubtful(work)):
        return
    work.tell("couplings and ratios of joints")
    search = (work.arm, work.points, work.targets)
    found = find_couplings(*search, frame_known=stated_frame, trust=work.settings.trust, moving=work.moving)
    if found is None and contested and _doubtful(work):
        found = find_couplings(*search, frame_known=False, trust=work.settings.trust, moving=work.moving)
    if found is None:
        return
    work.settings = replace(work.settings, frame_known=stated_frame)
    work.warnings = [w for w in work.warnings if w != work.moved_frame]
    reported = work.points.q
    _link(work, found.matrix)
    first_fit(work)
    if found.free:
        points = work.points.deflected(entry_columns(reported, found.free))
        scale = np.full(len(found.free), 0.05)
        better = fit(work.parameters, points, start=work.estimate.values, extension_scale=scale)
        matrix, std = refined(found.matrix, found.free, better)
        _link(work, matrix @ np.linalg.inv(found.matrix))
        work.coupling_std = std
        first_fit(work)


def align_orientations(work: Work) -> None:
    """Orientations become those of a frame that is nearly parallel to the last link's."""
    found = aimed(work.first, work.points)
    for number, turn in found.items():
        work.aims[number] = turn @ work.aims.get(number, np.eye(3))
    if found:
        work.runs = [realigned(run, found) for run in work.runs]
        work.held_out = [realigned(run, found) for run in work.held_out]
        work.points = points_of(work.runs, work.rows)


def weigh_orientations(work: Work) -> bool:
    """Orientations weigh by the ratio of both noises, as the residuals show it. Whether there are any."""
    lever = lever_of(
        work.points, residuals(work.parameters, work.estimate.values, work.estimate.extension, work.points)
    )
    if lever is None:
        return False
    for runs in (work.runs, work.held_out):
        runs[:] = [replace(run, lever=lever) if run.lever else run for run in runs]
    work.points = replace(work.points, lever=np.where(work.points.oriented, lever, 0.0))
    return True


def representatives(work: Work, outlier: Mask) -> Index:
    """One point of every block among the outliers (N,) bool, and one among the others: neighbours say the same."""
    number = blocks(work.runs, work.rows)
    return np.sort(np.unique(2 * number + outlier, return_index=True)[1])


def pattern(work: Work) -> str | None:
    """What the points that were left out of the fit share, or None."""
    outlier = ~work.estimate.inlier
    some = representatives(work, outlier)
    ends = np.searchsorted(some, np.cumsum([0, *map(len, work.rows)]))
    runs = [np.arange(a, b) for a, b in pairwise(ends)]
    return shared(
        work.points.q[some], work.points.xyz[some], outlier[some], runs, [not j.revolute for j in work.arm.joints]
    )


def _doubtful(work: Work) -> bool:
    """Whether points were left out that could be the model's fault, or the rest fits worse than any tracker is."""
    out = 1.0 - float(np.mean(work.estimate.inlier))
    few = len(work.points) <= _FEW
    return (
        work.estimate.noise > work.settings.most_noise or out > (0.0 if few else OUTLIERS) or pattern(work) is not None
    )


def _link(work: Work, matrix: Array) -> None:
    """Link angles of all runs become matrix (n, n) times what they were."""
    work.runs = [linked(run, matrix) for run in work.runs]
    work.held_out = [linked(run, matrix) for run in work.held_out]
    work.coupling = matrix @ work.coupling


def linked(run: Run, matrix: Array) -> Run:
    """The run with joint angles matrix (n, n) times its own, and its encoders' counts as large as they then are."""
    count = None if run.count is None else np.abs(matrix) @ run.count
    return replace(run, q=run.q @ matrix.T, count=count)
