"""Exciting motions."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.experiment_design.excitation import Limits, Series, design_excitation
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Limits",
    "Series",
    "design_excitation",
]
