"""Exciting motions."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.experiment_design.excitation import design_excitation
    from identification.experiment_design.fourier_series import Series
    from identification.experiment_design.limits import Limits
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Limits",
    "Series",
    "design_excitation",
]
