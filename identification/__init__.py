"""Recordings -> parameters: dynamics, friction, kinematics, experiment design."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.base_result import BaseIdentification
    from identification.identify import check_runs, identify_by, own_friction
    from identification.prediction import predict
    from identification.regression.model_parameters import without_rotors
    from identification.result import Identification, JointNoise, Prediction
    from identification.signal_words import recorded_quantities, recorded_quantity, recorded_signals
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "BaseIdentification",
    "Identification",
    "JointNoise",
    "Prediction",
    "check_runs",
    "identify_by",
    "own_friction",
    "predict",
    "recorded_quantities",
    "recorded_quantity",
    "recorded_signals",
    "without_rotors",
]
