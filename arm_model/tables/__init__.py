"""Tables of a model file that stand on their own: the types of entries, and the floating base."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.tables.base_values import base_parameters, unit_of, with_base_parameters
    from arm_model.tables.floating_base import DEGREES, FloatingBase, StationKeeping, Thruster
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "DEGREES",
    "FloatingBase",
    "StationKeeping",
    "Thruster",
    "base_parameters",
    "unit_of",
    "with_base_parameters",
]
