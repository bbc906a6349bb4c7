"""An arm with its drives, transmissions, effects and servos as one system of equations, and its inverse."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.system.along_motion import mass_matrix_along, rigid_torque_along
    from arm_model.system.dynamics import inverse_dynamics
    from arm_model.system.kernel_inputs import numbers
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "inverse_dynamics",
    "mass_matrix_along",
    "numbers",
    "rigid_torque_along",
]
