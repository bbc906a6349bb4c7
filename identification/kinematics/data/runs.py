"""A recording as calibration sees it: joint angles and tracked points of the same triggers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.models.chain import Index, Mask


@dataclass(frozen=True)
class Run:
    """One target in one recording: name, t (N,) s, q (N, joints) rad or m, xyz (N, 3) m; NaN where missing.

    Row k of all is one trigger.

    count     (joints,) rad of one count where an encoder's zero is this run's own, else 0; None: not known
              (``encoder_steps``)
    still     every row is a pose at rest; t only numbers them
    target    number of the target, from 0
    lever     m: 0 where xyz are positions; else they are rotation vectors (rad) of the target's frame, and an error of
              1 rad counts as one of ``lever`` metres
    recorded  the recording or table; runs of one have the same rows. "": ``name``
    file_row  (N,) the first row of the file that each pose is, from 0; None: row k is row k
    std       m, stated standard deviation of a coordinate of a point (``Points.std``); 0: none was stated
    """

    name: str
    t: Array
    q: Array
    xyz: Array
    count: Array | None = None
    still: bool = False
    target: int = 0
    lever: float = 0.0
    recorded: str = ""
    file_row: Index | None = None
    std: float = 0.0

    @property
    def source(self) -> str:
        """The recording or table that the rows are those of."""
        return self.recorded or self.name

    @property
    def usable(self) -> Mask:
        """(N,) bool: rows with all joint angles and a point."""
        return np.asarray(np.isfinite(self.q).all(axis=1) & np.isfinite(self.xyz).all(axis=1), bool)

    @property
    def period(self) -> float:
        """Median row interval, s."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0

    def velocity(self) -> Array:
        """dq/dt (N, joints), central differences smoothed over 9 rows; zero where it cannot be determined."""
        if len(self.t) < 3 or self.still:
            return np.zeros_like(self.q)
        slope = np.gradient(self.q, self.t, axis=0)
        kernel = np.ones(min(9, len(slope)))
        good = np.isfinite(slope).astype(float)
        total = np.column_stack([np.convolve(column, kernel, "same") for column in np.nan_to_num(slope).T])
        count = np.column_stack([np.convolve(column, kernel, "same") for column in good.T])
        return total / np.maximum(count, 1.0)


def shifted(run: Run, first: int, by: int) -> Run:
    """The run with its points from row ``first`` on taken from ``by`` rows later (earlier if negative).

    Rows that get no point this way have NaN.
    """
    xyz = run.xyz.copy()
    rows = np.arange(first, len(xyz))
    source = rows + by
    inside = (source >= 0) & (source < len(xyz))
    xyz[rows] = np.nan
    xyz[rows[inside]] = run.xyz[source[inside]]
    return replace(run, xyz=xyz)


def thinned(runs: Sequence[Run], most: int) -> list[Index]:
    """Row numbers of the usable points of every run, evenly thinned so that all together are at most ``most``."""
    rows = [np.flatnonzero(run.usable) for run in runs]
    stride = max(1, -(-sum(map(len, rows)) // most))
    return [r[::stride] for r in rows]


def poses_of(runs: Sequence[Run]) -> int:
    """Number of poses: rows of recordings in which a target was seen, however many targets."""
    seen: dict[str, Mask] = {}
    for run in runs:
        seen[run.source] = run.usable | seen.get(run.source, False)
    return sum(int(rows.sum()) for rows in seen.values())


def points_of(runs: Sequence[Run], rows: Sequence[Index]) -> Points:
    """The chosen rows of all runs, one after the other."""
    q = np.concatenate([run.q[r] for run, r in zip(runs, rows, strict=True)])
    xyz = np.concatenate([run.xyz[r] for run, r in zip(runs, rows, strict=True)])
    std = max((run.std for run in runs), default=0.0)
    if not any(run.target or run.lever for run in runs):
        return Points(q, xyz, std=std)
    target = np.concatenate([np.full(len(r), run.target) for run, r in zip(runs, rows, strict=True)])
    lever = np.concatenate([np.full(len(r), run.lever) for run, r in zip(runs, rows, strict=True)])
    return Points(q, xyz, None, target, lever, std)


def velocity_of(runs: Sequence[Run], rows: Sequence[Index]) -> Array:
    """Joint velocities (N, joints) of the chosen rows."""
    return np.concatenate([run.velocity()[r] for run, r in zip(runs, rows, strict=True)])


def correlation_time(residual: Array, rows: Sequence[Index]) -> float:
    """How many points in a row count as one, >= 1: the integrated autocorrelation of residuals (N, 3), in points.

    Points of one sweep share encoder steps and what the model lacks; taken as independent they would promise too much
    (Sokal, "Monte Carlo methods in statistical mechanics", 1996: window at five times the integral).
    """
    ends = np.cumsum([0, *map(len, rows)])
    longest = min(4000, max(map(len, rows)) - 1)
    if longest < 2:
        return 1.0
    covariance = np.zeros(longest + 1)
    pairs = np.zeros(longest + 1)
    for first, last in pairwise(ends):
        part = residual[first:last] - residual[first:last].mean(axis=0) if last > first else residual[first:last]
        size = 1 << max(2 * len(part) - 1, 1).bit_length()
        spectrum = np.abs(np.fft.rfft(part, size, axis=0)) ** 2
        lags = np.fft.irfft(spectrum, size, axis=0).sum(axis=1)[: min(longest + 1, len(part))]
        covariance[: len(lags)] += lags
        pairs[: len(lags)] += len(part) - np.arange(len(lags))
    if covariance[0] <= 0:
        return 1.0
    rho = (covariance / np.maximum(pairs, 1)) / (covariance[0] / pairs[0])
    integral = 2.0 * np.cumsum(rho) - 1.0
    window = np.flatnonzero(np.arange(longest + 1) >= 5.0 * integral)
    return float(max(1.0, integral[window[0] if len(window) else -1]))


def correlation_in_poses(residual: Array, runs: Sequence[Run], rows: Sequence[Index]) -> float:
    """How many reflectors of one pose count as one, >= 1, from residuals (N, 3) m of the chosen rows of all runs.

    They share the errors of the joint angles. Of independent residuals the square of a pose's sum is the sum of its
    squares (Kish, "Survey Sampling", 1965: the design effect of clusters).
    """
    key = [(run.source, int(row)) for run, which in zip(runs, rows, strict=True) for row in which]
    number = {one: k for k, one in enumerate(dict.fromkeys(key))}
    pose = np.array([number[one] for one in key], int)
    total = float(np.sum(residual**2))
    if len(number) == len(key) or total <= 0:
        return 1.0
    together = sum(float(np.sum(np.bincount(pose, column) ** 2)) for column in residual.T)
    return max(1.0, together / total)


def aligned(predicted: Array, measured: Array) -> Array:
    """Pose (4, 4) of the predicted points' frame in the frame of the measured ones (Kabsch 1976).

    measured = R predicted + p, by least squares over the points that agree; outliers are left out.
    """
    weight = np.ones(len(predicted), bool)
    pose = np.eye(4)
    for _ in range(30):
        a, b = predicted[weight], measured[weight]
        u, _, v = np.linalg.svd((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)))
        turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
        pose[:3, :3], pose[:3, 3] = turn, b.mean(axis=0) - turn @ a.mean(axis=0)
        off = np.linalg.norm(measured - predicted @ turn.T - pose[:3, 3], axis=1)
        fresh = off <= max(4.0 * float(np.median(off)), 1e-9)
        if np.array_equal(fresh, weight) or fresh.sum() < 4:
            break
        weight = fresh
    return pose
