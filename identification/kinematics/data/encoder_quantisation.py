"""What the steps of a counted encoder add to a tracked point, and what of it can be taken away.

Within a run, the counts of neighbouring rows tell where between two counts a moving motor stands: the angles are smoothed over a
few hundredths of a second, which an arm's motion does not notice. From run to run, a counter that is set at each start
(``preset = "start"``) is up to a count off, anew each time: on the Puma's joint 2 a count is 0.07 mm at the target, as much as the
tracker's noise. Runs that are fitted each get zeros of their own, with a count as prior deviation; of a run that is to be
predicted nobody can know them, and ``expected`` says how much that is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_filter

from arm_io.types import Array
from daq.recording import Recording
from identification.kinematics.data.runs import Run, points_of, velocity_of
from identification.kinematics.estimation.extensions import Extension, Gravity, deflections, prior_scales
from identification.kinematics.estimation.map_estimation import Fit, Points, fit
from identification.kinematics.models.chain import Chain, Index, position_jacobian
from identification.kinematics.models.parameters import Parameters

SMOOTHED = 0.025
"""s: length of the local cubics; what is slower than 60 Hz passes."""
_PAUSE = 1.5
"""Periods between two rows that are not neighbours."""


def between_counts(t: Array, q: Array) -> Array:
    """Angles q (N, joints) rad at t (N,) s as local cubics over ``SMOOTHED`` s (Savitzky and Golay, Anal. Chem. 36, 1964).

    Rows nearer to a missing sample than that, stretches shorter than that, and rows too far apart for it stay as they are.
    """
    smooth = q.copy()
    period = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    rows = 2 * int(SMOOTHED / 2 / period) + 1 if period > 0 else 0
    if rows < 5:
        return smooth
    there = np.isfinite(q)
    whole = uniform_filter1d(there.astype(float), rows, axis=0, mode="nearest") > 1 - 0.5 / rows
    bridged = np.column_stack(
        [np.interp(t, t[ok], column[ok]) if ok.any() else column for ok, column in zip(there.T, q.T)]
    )
    edges = [0, *(np.flatnonzero(np.diff(t) > _PAUSE * period) + 1), len(t)]
    for first, last in pairwise(edges):
        if last - first >= rows:
            local = savgol_filter(bridged[first:last], rows, 3, axis=0)
            smooth[first:last] = np.where(whole[first:last], local, q[first:last])
    return smooth


def counts_of(recording: Recording) -> Array | None:
    """(joints,) rad of one count of the encoders whose zero is set anew at every start, 0 for others; None where it is not known."""
    calibration, joints = recording.calibration, recording.rig.get("joint", [])
    if calibration is None or len(joints) != recording.joints or "scale" not in calibration:
        return None
    anew = [joint.get("encoder", {}).get("preset") == "start" for joint in joints]
    return np.where(anew, 1.0 / np.abs(np.array(calibration["scale"], float)), 0.0)


def with_own_zeros(
    parameters: Parameters,
    runs: Sequence[Run],
    rows: Sequence[Index],
    estimate: Fit,
    chosen: Sequence[Extension],
    gravity: Gravity | None,
) -> tuple[Points, Fit, Array]:
    """The fit with a zero of its own for every counted encoder of every run, and those zeros (zeros,) rad."""
    columns, counts = zero_columns(runs, rows)
    points = points_of(runs, rows)
    bend = deflections(chosen, points.q, velocity=velocity_of(runs, rows), gravity=gravity)
    both = Points(points.q, points.xyz, np.concatenate((bend, columns), axis=2))
    scale = np.concatenate((prior_scales(chosen), counts))
    own, found = bend.shape[2], len(estimate.extension)
    start = np.concatenate((estimate.extension, np.zeros(len(counts))))
    fitted = fit(parameters, both, start=estimate.values, extension_scale=scale, extension_start=start)
    zeros = fitted.extension[own:]
    kept = len(parameters.free) + found
    marginal = replace(fitted, extension=fitted.extension[:found], covariance=fitted.covariance[:kept, :kept])
    moved = Points(points.q + columns @ zeros, points.xyz, bend if chosen else None)
    return moved, marginal, zeros


def zero_columns(runs: Sequence[Run], rows: Sequence[Index]) -> tuple[Array, Array]:
    """Deflections (N, joints, zeros) of the chosen rows of all runs, and prior deviations (zeros,) rad: one zero a run and joint.

    Runs without a known count have none.
    """
    owners = [(k, j) for k, run in enumerate(runs) if run.count is not None for j in np.flatnonzero(run.count)]
    which = np.concatenate([np.full(len(r), k) for k, r in enumerate(rows)])
    columns = np.zeros((len(which), runs[0].q.shape[1], len(owners)))
    for index, (k, j) in enumerate(owners):
        columns[which == k, j, index] = 1.0
    return columns, np.array([_count(runs[k])[j] for k, j in owners])


def with_zeros(runs: Sequence[Run], zeros: Array) -> list[Run]:
    """The runs with their zeros (zeros,) rad, in the order of ``zero_columns``, put right."""
    out, left = [], list(zeros)
    for run in runs:
        off = np.zeros(run.q.shape[1])
        if run.count is not None:
            for j in np.flatnonzero(run.count):
                off[j] = left.pop(0)
        out.append(replace(run, q=run.q + off))
    return out


def expected(chain: Chain, runs: Sequence[Run]) -> float:
    """m rms a coordinate: error of predicted points from the zeros of runs alone.

    The count that a counter is set to, and the place within it where the motor stands, are each off by step / sqrt(12).
    """
    squares, points = 0.0, 0
    for run in runs:
        rows = np.flatnonzero(run.usable)
        rows = rows[:: max(1, len(rows) // 2000)]
        if run.count is not None and len(rows):
            joint = position_jacobian(chain, run.q[rows])[1][:, :, chain.joint_steps()]
            squares += len(rows) * float(np.mean(np.sum((joint * run.count) ** 2, axis=2))) / 6.0
        points += len(rows)
    return float(np.sqrt(squares / points)) if points else 0.0


def _count(run: Run) -> Array:
    assert run.count is not None
    return run.count
