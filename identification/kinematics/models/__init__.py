"""Kinematic chains and their parameterisations."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.kinematics.models.chain import Chain, position, position_jacobian, xyz_ypr
    from identification.kinematics.models.denavit_hartenberg import in_denavit_hartenberg
    from identification.kinematics.models.parameters import (
        UNKNOWN_TARGET,
        Parameters,
        Trust,
        calibrated_arm,
        chain_of,
        parallel_next,
    )
    from identification.kinematics.models.placed import placed_as
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "UNKNOWN_TARGET",
    "Chain",
    "Parameters",
    "Trust",
    "calibrated_arm",
    "chain_of",
    "in_denavit_hartenberg",
    "parallel_next",
    "placed_as",
    "position",
    "position_jacobian",
    "xyz_ypr",
]
