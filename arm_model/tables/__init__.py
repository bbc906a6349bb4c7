"""What stands on its own of a model file: the types of entries, the floating base, how well parameters are known."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.tables.base_values import OF_THRUSTER, base_parameters, unit_of, with_base_parameters
    from arm_model.tables.floating_base import DEGREES, FloatingBase, StationKeeping, Thruster
    from arm_model.tables.uncertainty import Uncertainty, uncertainty_of
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "DEGREES",
    "OF_THRUSTER",
    "FloatingBase",
    "StationKeeping",
    "Thruster",
    "Uncertainty",
    "base_parameters",
    "uncertainty_of",
    "unit_of",
    "with_base_parameters",
]
