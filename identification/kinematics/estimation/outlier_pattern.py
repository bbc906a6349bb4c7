"""What points that the model does not fit have in common: a wrong point is anywhere, a wrong model is somewhere.

Beam breaks and bad readings fall on any pose. Points that share a sweep, a range of a joint or a region of space mean
that the model lacks something there.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import ks_2samp

from arm_io.types import Array
from identification.kinematics.circle_points.sweeps import ALONE
from identification.kinematics.data.blocks import blocks
from identification.kinematics.data.measured import ends_of
from identification.kinematics.estimation.estimated import Estimated
from identification.kinematics.models.chain import Index, Mask

OUTLIERS = 0.05
"""Share of the points left out, above which the model is at fault and not the points."""
LEAST = 3
"""Points that can share anything."""
CHANCE = 1e-3
"""Probability that all tests together find a pattern where there is none."""
_MOST = 0.8
"""Share of the outliers in one sweep that makes it theirs, unless that many of the other points are in it."""


def pattern(estimated: Estimated) -> str | None:
    """What the points that were left out of the fit share, or None."""
    measured, points, outlier = estimated.measured, estimated.points, ~estimated.fit.inlier
    # one point of every block among the outliers, and one among the others: neighbours say the same
    number = blocks(measured.runs, measured.rows)
    some = np.sort(np.unique(2 * number + outlier, return_index=True)[1])
    ends = np.searchsorted(some, ends_of(measured.rows))
    runs = [np.arange(a, b) for a, b in pairwise(ends)]
    prismatic = [not j.revolute for j in estimated.arm.joints]
    return shared(points.q[some], points.xyz[some], outlier[some], runs, prismatic)


def shared(q: Array, xyz: Array, outlier: Mask, runs: Sequence[Index], prismatic: Sequence[bool] = ()) -> str | None:
    """What the outliers (N,) share, for a sentence ("the sweep of joint 2"); None: nothing beyond chance.

    q (N, joints) rad (m), xyz (N, 3) m; runs: numbers of the points of each run, in order of time; prismatic: which
    joints slide, () for none.
    """
    if outlier.sum() < LEAST or (~outlier).sum() < LEAST:
        return None
    swept = np.concatenate([_swept(q[rows]) for rows in runs])
    for joint in range(1, q.shape[1] + 1):
        theirs, others = np.mean(swept[outlier] == joint), np.mean(swept[~outlier] == joint)
        if theirs >= _MOST and others < _MOST / 2:
            return f"the sweep of joint {joint}"
    names = [*(f"joint {j}" for j in range(1, q.shape[1] + 1)), "x", "y", "z"]
    values = [*q.T, *xyz.T]
    tests = [ks_2samp(value[outlier], value[~outlier]).pvalue for value in values]
    best = int(np.argmin(tests))
    if tests[best] > CHANCE / len(tests):
        return None
    low, high = values[best][outlier].min(), values[best][outlier].max()
    if best >= q.shape[1]:
        return f"the region {names[best]} from {low:.3g} to {high:.3g} m"
    slides = best < len(prismatic) and prismatic[best]
    what, unit = ("positions", "m") if slides else ("angles", "rad")
    return f"{what} of {names[best]} from {low:.3g} to {high:.3g} {unit}"


def _swept(q: Array) -> Index:
    """(N,) the joint (from 1) that alone moves at every row, from its neighbours; 0: none or several."""
    if len(q) < LEAST:
        return np.zeros(len(q), int)
    step = np.abs(np.diff(q, axis=0))
    order = np.sort(step, axis=1)
    alone = (order[:, -1] > 0) & ((order[:, -2] if q.shape[1] > 1 else 0.0) <= ALONE * order[:, -1])
    joint = np.where(alone, step.argmax(axis=1) + 1, 0)
    return np.asarray(np.where(np.r_[joint, 0] > 0, np.r_[joint, 0], np.r_[0, joint]), int)
