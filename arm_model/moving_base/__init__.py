"""An arm on a base that moves in six degrees of freedom: its recursions, numbers, and the regressor of its wrench."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.moving_base.numeric import (
        BaseRows,
        floating,
        forces_with_base,
        mass_matrix_with_base,
        rotations,
    )
    from arm_model.moving_base.regressor import (
        OF_ARM,
        PAYLOAD,
        REACTION,
        beyond,
        hull_wrench,
        loaded,
        nominal_wrench_parameters,
        thrust_of,
        wrench_columns,
    )
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "OF_ARM",
    "PAYLOAD",
    "REACTION",
    "BaseRows",
    "beyond",
    "floating",
    "forces_with_base",
    "hull_wrench",
    "loaded",
    "mass_matrix_with_base",
    "nominal_wrench_parameters",
    "rotations",
    "thrust_of",
    "wrench_columns",
]
