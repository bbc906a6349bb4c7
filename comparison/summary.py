"""One cause that explains several changes, in numbers and words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

SIGNIFICANT_STDS = 4.0
"""Deviations from zero that mass, or scale, must have."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """One cause that explains several changes.

    effect     payload, torque_constant (which a current gain is indistinguishable from), link_inertia, or an effect
               beyond the model
    joint      from 1; None: of the whole arm
    parameters name -> value, std, unit; of a torque constant its relative error, of a payload mass and centre; of the
               others the table has them
    explains   names of the significant changes that it makes
    """

    effect: str
    joint: int | None
    parameters: dict[str, tuple[float, float, str]]
    explains: tuple[str, ...]
    sentence: str

    def to_json(self) -> dict[str, Any]:
        """As compare.json has it."""
        return {
            "effect": self.effect,
            "joint": self.joint,
            "parameters": {
                name: {"value": value, "std": std, "unit": unit} for name, (value, std, unit) in self.parameters.items()
            },
            "explains": list(self.explains),
            "sentence": self.sentence,
        }


def of_significant(count: int, of: int) -> str:
    """``all 7 significant changes``: how many of them a cause explains."""
    if count < of:
        return f"{count} of {of} significant changes"
    return "the only significant change" if count == 1 else f"all {count} significant changes"
