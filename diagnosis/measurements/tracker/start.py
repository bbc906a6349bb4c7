"""Where the tracker's frame and the target are before the search: as rig files state it, or as points show it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import described
from daq.recording import Recording
from diagnosis.measurements.tracker.joint_fit import Survey
from diagnosis.measurements.tracker.points import points_of
from identification.kinematics.data import aligned
from identification.kinematics.models import Chain, chain_of, position, xyz_ypr

ALTERNATIONS = 30
"""Fits of frame and target in turn, where neither is known: what is left of 0.1 m is below a micrometre."""
Part = list[tuple[Recording, Array]]
"""Recordings with tracked points, and the angles (rows, n) rad of the links in each."""


def survey_of(recordings: Sequence[Recording]) -> Survey:
    """Frame and target as the rig files in the recordings state them."""
    stated = recordings[0].rig.get("tracker", {}).get("target")
    x, y, z = (float(v) for v in stated or (0.0, 0.0, 0.0))
    return Survey(
        target=(x, y, z), target_known=stated is not None, frame_known=all(r.xyz is not None for r in recordings)
    )


def start_of(arm: Arm, part: Part, survey: Survey) -> Chain:
    """The model's chain; pose of the tracker and target, if no rig file states them, are fitted to the points."""
    chain = chain_of(described(arm), survey.target)
    q = np.concatenate([angles for _, angles in part])
    xyz = np.concatenate([_points(r) for r, _ in part])
    there = np.isfinite(xyz).all(axis=1)
    q, xyz = q[there], xyz[there]
    # solved alternately, which converges
    rounds = 1 if survey.target_known or survey.frame_known else ALTERNATIONS
    for _ in range(rounds):
        if not survey.frame_known:
            chain = _based(arm, chain, aligned(position(_based(arm, chain, np.eye(4)), q), xyz))
        if not survey.target_known:
            chain = _targeted(chain, q, xyz)
    return chain


def _based(arm: Arm, chain: Chain, pose: Array) -> Chain:
    """The chain with its base moved by a ``pose`` (4, 4) of the tracker."""
    place = np.linalg.inv(np.array(arm.base)) @ pose @ np.array(arm.base)
    moved = dict(zip(("x", "y", "z", "yaw", "pitch", "roll"), xyz_ypr(place), strict=True))
    return chain.at([moved[s.name[5:]] if s.name.startswith("base.") else s.value for s in chain.steps])


def _targeted(chain: Chain, q: Array, xyz: Array) -> Chain:
    """The chain with the target (3,) m that fits points (N, 3) m best: they are linear in it."""
    axes = [k for k, step in enumerate(chain.steps) if step.name.startswith("target.")]
    values = np.array([step.value for step in chain.steps])
    values[axes] = 0.0
    without = position(chain.at(values), q)
    unit = [position(chain.at(values + (np.arange(len(values)) == k)), q) - without for k in axes]
    columns = np.stack(unit, axis=-1).reshape(-1, len(axes))
    values[axes] = np.linalg.lstsq(columns, (xyz - without).ravel(), rcond=1e-9)[0]
    return chain.at(values)


def _points(recording: Recording) -> Array:
    """(rows, 3) m of a recording that has tracked points."""
    points = points_of(recording)
    assert points is not None
    return points
