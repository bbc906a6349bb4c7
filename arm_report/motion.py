"""The arm that moved while something was recorded, to be drawn at the row that is pointed at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from arm_io.types import Array

POSES = 1200
"""Of a clip, at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Clip:
    """Joint positions q (k, n) rad (m) of the drives at places t (k,) of a panel's x axis, ascending; no NaN.

    name  of the recording
    x     label of that axis: "time, s", or "row" of poses
    pose  (k, 7) of the base: position m and unit quaternion w, x, y, z from body to world; None: it stands
    """

    t: Array
    q: Array
    name: str
    x: str = "time, s"
    pose: Array | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """arm: ``arm_clearance.Chain.to_json``; clips by the name that ``Panel.motion`` has.

    arm["hull"], of an arm on a vehicle: lines [from, to, radius], m in the frame of the moving base.
    """

    arm: Mapping[str, Any]
    clips: Mapping[str, Clip]


def clip_of(t: Array, q: Array, name: str, x: str = "time, s", pose: Array | None = None) -> Clip:
    """A clip of at most ``POSES`` of these rows, without those that lack a joint."""
    complete = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(t))
    kept = complete[:: max(1, -(-len(complete) // POSES))]
    return Clip(t=t[kept], q=q[kept], name=name, x=x, pose=None if pose is None else pose[kept])
