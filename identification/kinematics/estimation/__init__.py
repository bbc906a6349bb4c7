"""Calibration: estimation of kinematic parameters, with cross-validation."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.kinematics.estimation.calibration import Calibration, calibrate
    from identification.kinematics.estimation.estimated import Settings
    from identification.kinematics.estimation.map_estimation import REJECT, Fit, fit, residuals, stacked
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "REJECT",
    "Calibration",
    "Fit",
    "Settings",
    "calibrate",
    "fit",
    "residuals",
    "stacked",
]
