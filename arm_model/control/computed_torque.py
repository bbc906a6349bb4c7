"""Computed torque: the arm's own equations undo its nonlinearity, linear feedback does the rest."""

from __future__ import annotations

from dataclasses import dataclass

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.system.dynamics import inverse_dynamics


@dataclass(frozen=True)
class Reference:
    """(n,) each: demanded position, rate and acceleration of the joints, rad, rad/s, rad/s2 (m)."""

    q: Array
    qd: Array
    qdd: Array


@dataclass(frozen=True)
class ComputedTorque:
    """Computed torque: the inverse dynamics of the demanded acceleration and of what is missing of the demand.

    tau = M(q) (q''_d + 2 zeta w (q'_d - q') + w^2 (q_d - q)) + h(q, q') + g(q) + friction + what water the model has.

    With a true model and no limit every joint's error obeys e'' + 2 zeta w e' + w^2 e = 0 (Markiewicz, JPL TM 33-601,
    1973). ``arm`` is what the controller believes; natural_frequency w rad/s.
    """

    arm: Arm
    natural_frequency: float
    damping_ratio: float = 1.0

    def torque(self, q: Array, qd: Array, reference: Reference) -> Array:
        """(n,) joint torque, N m (N), that no limit has cut yet."""
        w = self.natural_frequency
        rate = 2 * self.damping_ratio * w * (reference.qd - qd) + w * w * (reference.q - q)
        return inverse_dynamics(self.arm, q[None], qd[None], (reference.qdd + rate)[None])[0]

    def observe(self, q: Array, qd: Array, applied: Array) -> None:
        """What the drives then gave; computed torque needs no memory of it."""
