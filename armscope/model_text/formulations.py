"""The formulations of the equations of motion, compared."""

from __future__ import annotations

from collections.abc import Sequence

from arm_model import Arm
from arm_model.formulations import SYMPY_JOINTS, Formulation


def formulations_text(arm: Arm, rows: Sequence[Formulation]) -> str:
    """A table, a formulation per line: operations, time to generate, difference of the torques."""
    lines = [
        f"{arm.name}: {len(arm)} joints, rigid links; difference of the torques on 100 random states, relative",
        f"{'formulation':<23}{'tau(q, qd, qdd)':>15}{'mass matrix, bias':>19}{'generated in':>14}{'difference':>12}",
    ]
    for row in rows:
        torque = "" if row.torque_operations is None else f"{row.torque_operations} op"
        system = f"{row.system_operations} op"
        lines.append(f"{row.name:<23}{torque:>15}{system:>19}{row.seconds * 1e3:>11.1f} ms{row.difference:>12.1e}")
    if len(arm) > SYMPY_JOINTS:
        lines.append(f"(sympy's methods are compared for up to {SYMPY_JOINTS} joints only; for more they take minutes)")
    return "\n".join(lines)
