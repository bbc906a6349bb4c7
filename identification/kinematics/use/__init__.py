"""What a calibration is used for: poses to measure, corrected targets, the ISO cube."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.kinematics.use.correction import Corrected
    from identification.kinematics.use.iso_cube import (
        NAME,
        SIDE,
        cube_experiment,
        cube_points,
        cube_report,
        cube_targets,
        posture_of,
    )
    from identification.kinematics.use.poses import PosePlan, experiment_of, select_poses
    from identification.kinematics.use.prediction import predicted
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "NAME",
    "SIDE",
    "Corrected",
    "PosePlan",
    "cube_experiment",
    "cube_points",
    "cube_report",
    "cube_targets",
    "experiment_of",
    "posture_of",
    "predicted",
    "select_poses",
]
