"""Identification of a floating base: thruster gains, added mass, drag and buoyancy from its recorded motion."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.floating_base.columns import FAULTS, Rows, nominal_values
    from identification.floating_base.fit import covariance, excited, fitted, noise_scale
    from identification.floating_base.held_out import Sides, sides
    from identification.floating_base.identify import identify_base
    from identification.floating_base.wrenches import Wrenches, wrenches_of
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "FAULTS",
    "Rows",
    "Sides",
    "Wrenches",
    "covariance",
    "excited",
    "fitted",
    "identify_base",
    "noise_scale",
    "nominal_values",
    "sides",
    "wrenches_of",
]
