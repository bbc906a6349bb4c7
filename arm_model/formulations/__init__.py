"""The equations of motion three ways: Newton-Euler (the one that is compiled), Lagrange, Kane; and what each costs."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.formulations.comparison import SYMPY_JOINTS, TORQUES, Formulation, compare
    from arm_model.formulations.links import symbols_of
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "SYMPY_JOINTS",
    "TORQUES",
    "Formulation",
    "compare",
    "symbols_of",
]
