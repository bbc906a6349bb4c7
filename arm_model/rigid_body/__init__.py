"""Rigid links in space: kinematics, inertia, the Newton-Euler recursion, its regressor, and the water around them."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.rigid_body.friction_curve import curve_at, curve_level, nearest_line, total_at
    from arm_model.rigid_body.gears import regeared
    from arm_model.rigid_body.gravity_level import gravity_levels
    from arm_model.rigid_body.hydrodynamics import COEFFICIENTS
    from arm_model.rigid_body.kinematics import forward, jacobian, link_frames, placement
    from arm_model.rigid_body.link_friction import LINK_FRICTION
    from arm_model.rigid_body.numeric import drive_mass_matrix, drive_rigid_torque, mass_matrix, rigid_torque
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "COEFFICIENTS",
    "LINK_FRICTION",
    "curve_at",
    "curve_level",
    "drive_mass_matrix",
    "drive_rigid_torque",
    "forward",
    "gravity_levels",
    "jacobian",
    "link_frames",
    "mass_matrix",
    "nearest_line",
    "placement",
    "regeared",
    "rigid_torque",
    "total_at",
]
