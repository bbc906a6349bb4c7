"""Joint angles between counts of incremental encoders, and encoders with a new zero in every run.

Within a run, the counts of neighbouring rows show where between two counts a moving motor is: the angles are smoothed
over ``SMOOTHED`` seconds, which is short against the motion of an arm.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_filter

from arm_io.types import Array
from daq.recording import Recording

SMOOTHED = 0.025
"""s: length of the local cubics; what is slower than 60 Hz passes."""
_PAUSE = 1.5
"""Periods between two rows that are not neighbours."""


def between_counts(t: Array, q: Array) -> Array:
    """Angles q (N, joints) rad at t (N,) s as local cubics over ``SMOOTHED`` s.

    Source: Savitzky and Golay, Anal. Chem. 36, 1964.

    Rows nearer to a missing sample than that, stretches shorter than that, and rows too far apart for it stay as they
    are.
    """
    smooth = q.copy()
    period = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    rows = 2 * int(SMOOTHED / 2 / period) + 1 if period > 0 else 0
    if rows < 5:
        return smooth
    there = np.isfinite(q)
    complete = uniform_filter1d(there.astype(float), rows, axis=0, mode="nearest") > 1 - 0.5 / rows
    bridged = np.column_stack(
        [np.interp(t, t[ok], column[ok]) if ok.any() else column for ok, column in zip(there.T, q.T)]
    )
    edges = [0, *(np.flatnonzero(np.diff(t) > _PAUSE * period) + 1), len(t)]
    for first, last in pairwise(edges):
        if last - first >= rows:
            local = savgol_filter(bridged[first:last], rows, 3, axis=0)
            smooth[first:last] = np.where(complete[first:last], local, q[first:last])
    return smooth


def counts_of(recording: Recording) -> Array | None:
    """(joints,) rad per count of encoders that are zeroed at every start, 0 for others; None if that is not known."""
    calibration, joints = recording.calibration, recording.rig.get("joint", [])
    if calibration is None or len(joints) != recording.joints or "scale" not in calibration:
        return None
    anew = [joint.get("encoder", {}).get("preset") == "start" for joint in joints]
    return np.where(anew, 1.0 / np.abs(np.array(calibration["scale"], float)), 0.0)
