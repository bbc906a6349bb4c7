"""A ripple that was looked at: what it is, how well it is known, and whether the model has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model import EffectTerm
from arm_model.effects import CATALOGUE

EFFECT = next(effect.name for effect in CATALOGUE.values() if effect.wave and effect.torque and effect.deflection)
"""The wave that any shaft of a gear may make, as a torque."""


@dataclass(frozen=True, kw_only=True)
class Ripple:
    """tau = torque sin(order motor + phase) at a joint (from 1).

    torque N m (N); order cycles per turn of the motor; phase rad at motor angle 0; motor: abs(gear) times the joint's
    angle. stays: whether the model has it; why: held-out errors, or what speaks against it.
    covariance  (3, 3) of torque, order and phase; an order that is a whole number of turns has no variance
    turn        of what shaft the order is a whole number: "motor", "joint", or "" for none
    """

    joint: int
    torque: float
    order: float
    phase: float
    covariance: Array
    turn: str
    stays: bool
    why: str

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations by parameter."""
        return dict(zip(("torque", "order", "phase"), np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).tolist()))

    @property
    def term(self) -> EffectTerm:
        """As the model file has it."""
        return EffectTerm(EFFECT, self.joint, {"torque": self.torque, "order": self.order, "phase": self.phase})

    def to_json(self) -> dict[str, Any]:
        """As identification.json has it."""
        values = {"torque": self.torque, "order": self.order, "phase": self.phase}
        parameters = {name: {"value": value, "std": self.std[name]} for name, value in values.items()}
        return {
            "joint": self.joint,
            "effect": EFFECT,
            "stays": self.stays,
            "why": self.why,
            "turn": self.turn,
            "parameters": parameters,
        }
