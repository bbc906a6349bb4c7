"""Proportional-derivative control of independent joints, with or without the weight of the arm fed forward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model.control.computed_torque import Reference
from arm_model.description import Arm
from arm_model.rigid_body.numeric import drive_mass_matrix
from arm_model.system.dynamics import inverse_dynamics


@dataclass(frozen=True)
class ProportionalDerivative:
    """tau = Kp (q_d - q) + Kd (q'_d - q') + weight(q).

    position (n,) N m/rad, velocity (n,) N m s/rad (N/m, N s/m); gravity_model: the arm whose weight is fed forward,
    or None.
    """

    position: Array
    velocity: Array
    gravity_model: Arm | None = None

    def torque(self, q: Array, qd: Array, reference: Reference) -> Array:
        """(n,) joint torque, N m (N), that no limit has cut yet."""
        asked = self.position * (reference.q - q) + self.velocity * (reference.qd - qd)
        if self.gravity_model is None:
            return asked
        still = np.zeros((1, len(q)))
        return np.asarray(asked + inverse_dynamics(self.gravity_model, q[None], still, still)[0])

    def observe(self, q: Array, qd: Array, applied: Array) -> None:
        """What the drives then gave; there is no memory of it."""


def tuned(arm: Arm, pose: Array, natural_frequency: Array, *, weight: bool = False) -> ProportionalDerivative:
    """Critically damped in a pose (n,) rad (m), each joint for itself: Kp = w^2 J, Kd = 2 w J, J its inertia there."""
    inertia = np.diag(drive_mass_matrix(arm, pose)[0])
    gains = np.asarray(natural_frequency, float)
    return ProportionalDerivative(gains**2 * inertia, 2.0 * gains * inertia, arm if weight else None)
