"""Calibration: estimation of kinematic parameters, with cross-validation."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.kinematics.estimation.calibration import Calibration, calibrate, predicted
    from identification.kinematics.estimation.map_estimation import REJECT, Fit, fit, residuals, stacked
    from identification.kinematics.estimation.work import Settings, linked
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "REJECT",
    "Calibration",
    "Fit",
    "Settings",
    "calibrate",
    "fit",
    "linked",
    "predicted",
    "residuals",
    "stacked",
]
