"""Identification of a floating base: thruster gains, added mass, drag and buoyancy from its recorded motion."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.floating_base.columns import Rows
    from identification.floating_base.fit import Sides, covariance, excited, fitted, identify_base, noise_scale, sides
    from identification.floating_base.result import BaseIdentification, BaseValue
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "BaseIdentification",
    "BaseValue",
    "Rows",
    "Sides",
    "covariance",
    "excited",
    "fitted",
    "identify_base",
    "noise_scale",
    "sides",
]
