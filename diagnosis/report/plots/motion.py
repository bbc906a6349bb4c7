"""The motion of the recordings, on the time axes of the charts."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model.collision import chain_of
from arm_report.motion import Motion, clip_of
from diagnosis.result import Diagnosis

HELD_OUT = "held out"
"""The clip of the held-out recordings, one after the other."""


def held_out_time(result: Diagnosis) -> Array:
    """(rows,) s: held-out recordings one after the other."""
    runs = result.held_out
    begins = np.cumsum([0.0, *(len(run.t) / run.per_second for run in runs)])
    return np.concatenate([begin + run.t - run.t[0] for begin, run in zip(begins, runs)])


def motion_of(result: Diagnosis) -> Motion:
    """The arm, and how it moved: all held-out recordings together, and each that is simulated by its name."""
    q = np.concatenate([run.q for run in result.held_out])
    clips = {HELD_OUT: clip_of(held_out_time(result), q, "held out", "time, s")}
    for pairs in result.closed_loops:
        for before, _ in pairs:
            clips[before.name] = clip_of(before.t, before.angle, before.name)
    return Motion(arm=chain_of(result.arm).to_json(), clips=clips)
