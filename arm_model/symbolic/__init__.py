"""Expressions as tapes of single operations, and tapes as text: equations, LaTeX, Python, C."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.symbolic import latex, printing
    from arm_model.symbolic.printing import shown
    from arm_model.symbolic.steps import Steps, steps_of
    from arm_model.symbolic.tape import Expr, Tape, needed, operations
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Expr",
    "Steps",
    "Tape",
    "latex",
    "needed",
    "operations",
    "printing",
    "shown",
    "steps_of",
]
