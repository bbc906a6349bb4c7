"""What stands on its own of a model file: types of entries, floating base, temperatures of a run, what is known."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.tables.base_values import OF_THRUSTER, base_parameters, unit_of, with_base_parameters
    from arm_model.tables.floating_base import DEGREES, FloatingBase, StationKeeping, Thruster
    from arm_model.tables.temperatures import Temperatures, constant_temperatures, recorded_temperatures
    from arm_model.tables.uncertainty import Uncertainty, uncertainty_of
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "DEGREES",
    "OF_THRUSTER",
    "FloatingBase",
    "StationKeeping",
    "Temperatures",
    "Thruster",
    "Uncertainty",
    "base_parameters",
    "constant_temperatures",
    "recorded_temperatures",
    "uncertainty_of",
    "unit_of",
    "with_base_parameters",
]
