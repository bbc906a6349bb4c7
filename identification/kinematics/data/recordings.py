"""Recordings as runs for calibration: tracked points of the same triggers, their frame, places of the targets."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import gravity_levels, rigid_torque
from daq.recording import Recording
from identification.kinematics.data.encoder_counts import between_counts, counts_of
from identification.kinematics.data.runs import Run
from identification.kinematics.data.tracker_file import Merge, merge, read_tracker
from identification.preprocessing.quality import NO_VALUE, as_trusted

Place = tuple[float, float, float]
"""m: where a target sits in the frame of the last link."""


@dataclass(frozen=True)
class Sighting:
    """A target as a recording or table has it.

    name      as the table calls it; "" where nothing does
    place     m in the frame of the last link, as the rig file or the table says, or None
    oriented  whether its orientation was tracked
    """

    name: str
    place: Place | None
    oriented: bool = False


@dataclass(frozen=True)
class Tracked:
    """A recording or table of poses, ready for calibration.

    runs         one per target (``Run.target`` counts through ``targets``), and one more per 6-D target
    frame_known  whether the points are in the base frame; else in the tracker's own
    experiment   its name, or ""
    merged       how a separate tracker file was put to its rows, or None
    notes        sentences about how a table was read
    """

    runs: tuple[Run, ...]
    frame_known: bool
    targets: tuple[Sighting, ...]
    experiment: str
    merged: Merge | None = None
    notes: tuple[str, ...] = ()

    @property
    def run(self) -> Run:
        """Positions of the first target."""
        return self.runs[0]

    @property
    def target(self) -> Place | None:
        """Place of the first target, where it is known."""
        return self.targets[0].place


def tracked(recording: Recording, tracker: Path | None = None) -> Tracked:
    """A recording with its tracked points, matched by trigger number; or with those of a separately recorded file.

    Angles and points that the instruments themselves call stale, late, missing or saturated are none. InputError where
    there are no points.
    """
    table = recording.rig.get("tracker", {})
    target = tuple(float(v) for v in table["target"]) if "target" in table else None
    merged = None
    if tracker is not None:
        file = read_tracker(tracker)
        merged = merge(recording.t, file)
        xyz = merged.points(file)
        pose = table.get("base_from_tracker")
        if pose is not None:
            xyz = xyz @ np.array(pose)[:3, :3].T + np.array(pose)[:3, 3]
        known = pose is not None
    else:
        xyz, known = _points(recording)
    experiment = (recording.experiment or {}).get("name", "")
    run = Run(
        recording.path.name,
        recording.t,
        between_counts(recording.t, as_trusted(recording).q),
        xyz,
        counts_of(recording),
    )
    return Tracked((run,), known, (Sighting("", target),), experiment, merged)  # type: ignore[arg-type]


def _points(recording: Recording) -> tuple[Array, bool]:
    """(n, 3) m, NaN where the tracker flagged the point, and whether they are in the base frame."""
    flagged = [rows[:, 0] for flag, rows in recording.flagged("points").items() if flag in (*NO_VALUE, "saturated")]
    for points, known in ((recording.xyz, True), (recording.points, False)):
        if points is not None:
            return np.where(np.any(flagged, axis=0)[:, None] if flagged else False, np.nan, points), known
    raise InputError(
        recording.path,
        "has no tracker points; must have columns x, y, z, or be given the tracker's own file with --tracker FILE.csv",
    )


@dataclass(frozen=True)
class Gravity:
    """How the weight of its links bears on the joints of an arm at rest."""

    arm: Arm

    @property
    def weighed(self) -> bool:
        """Whether the model has masses."""
        return bool(np.any(self.arm.joint_array("mass")))

    def torque(self, q: Array) -> Array:
        """(N, joints) N m that hold the arm at link angles q (N, joints)."""
        return rigid_torque(self.arm, q, np.zeros_like(q), np.zeros_like(q))

    def levels(self, q: Array, link: int) -> Array:
        """(N, joints, 2): ``arm_model.rigid_body.gravity_level`` of one link (from 1), whatever its mass."""
        return gravity_levels(self.arm, q, link)


def gravity_of(arm: Arm) -> Gravity | None:
    """The weight of an arm's links; None without gravity."""
    return Gravity(arm) if np.any(arm.gravity) else None
