"""Poses and tracker points taken from recordings."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.kinematics.data.measured import linked
    from identification.kinematics.data.points import Points
    from identification.kinematics.data.pose_table import HOLDS, read_poses
    from identification.kinematics.data.recordings import Place, Tracked, gravity_of, tracked
    from identification.kinematics.data.repeated_poses import Poses, check_new
    from identification.kinematics.data.runs import aligned, correlation_time
    from identification.kinematics.data.targets import common_targets
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "HOLDS",
    "Place",
    "Points",
    "Poses",
    "Tracked",
    "aligned",
    "check_new",
    "common_targets",
    "correlation_time",
    "gravity_of",
    "linked",
    "read_poses",
    "tracked",
]
