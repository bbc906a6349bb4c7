"""What a calibration is used for: poses to measure, corrected targets, the ISO cube."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.kinematics.use.iso_cube import NAME, cube_report
    from identification.kinematics.use.pose_files import POSES, cubes_of, write_cubes, write_poses
    from identification.kinematics.use.poses import experiment_of, select_poses
    from identification.kinematics.use.prediction import predicted
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "NAME",
    "POSES",
    "cube_report",
    "cubes_of",
    "experiment_of",
    "predicted",
    "select_poses",
    "write_cubes",
    "write_poses",
]
