"""Hydraulic drives between a controller and the joints: first-order actuators whose flow is limited.

A servo valve of constant supply pressure on a cylinder or rotary motor (Merritt, Hydraulic Control Systems, 1967,
chapter 3). With the pressure across the load p_L = F / A, and the flow v A that the joint takes up, the open valve lets

    v A = Q sqrt(1 - p_L / p_s)        so that        |F| <= F_stall (1 - (v / v_free)^2)

against a load that resists the motion: the whole force at rest, none at the speed v_free = Q / A of the whole flow, and
beyond that the drive brakes. Against the motion the relief valves give at most F_stall. Within these bounds the force
follows its command with one time constant, that of valve and oil.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model.control.computed_torque import Reference
from arm_model.control.torque_control import TorqueController


@dataclass(frozen=True)
class Hydraulics:
    """stall (n,) N m (N): force of the whole pressure; free (n,) rad/s (m/s): speed of the whole flow; lag s."""

    stall: Array
    free: Array
    lag: float

    def bounds(self, speed: Array) -> tuple[Array, Array]:
        """(n,) lowest and highest force at speeds (n,)."""
        share = np.sign(speed) * (speed / self.free) ** 2
        low, high = -self.stall * (1.0 + share), self.stall * (1.0 - share)
        return np.clip(low, -self.stall, self.stall), np.clip(high, -self.stall, self.stall)


@dataclass
class HydraulicDrives:
    """A controller whose commands pass through hydraulic drives: itself a ``TorqueController``, called every period s.

    force  (n,) N m (N): of the drives, at the start that of the arm at rest; kept from call to call
    """

    controller: TorqueController
    hydraulics: Hydraulics
    period: float
    force: Array

    def torque(self, q: Array, qd: Array, reference: Reference) -> Array:
        """(n,) the force that the drives give."""
        command = self.controller.torque(q, qd, reference)
        low, high = self.hydraulics.bounds(qd)
        # exact over a period in which the command is held
        share = -np.expm1(-self.period / self.hydraulics.lag)
        self.force = np.clip(self.force + share * (np.clip(command, low, high) - self.force), low, high)
        return self.force

    def observe(self, q: Array, qd: Array, applied: Array) -> None:
        """Passed on to the controller."""
        self.controller.observe(q, qd, applied)
