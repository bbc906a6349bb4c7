"""A demanded motion slowed where the drives cannot follow it, so that limits cost time and not accuracy.

The demand is run along s instead of t, with s' = sigma <= 1: q_d(s), its rate sigma q_d', its acceleration sigma^2
q_d'' + x q_d' with x = sigma'. The controller's torque is affine in x; of the x that keep every joint within its limit
the one nearest to the reference (1 - sigma) / recovery is taken (Dahl and Nielsen, "Torque-limited path following by
online trajectory time scaling", IEEE Trans. Robotics and Automation 6(5), 1990). Where no x does, the motion is slowed.

It does not look ahead: it suits motions that drag or friction helps to brake, as in water. At rest x moves nothing: the
demand has to set out, and turn round, with accelerations that the drives can give.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.control.computed_torque import Reference
from arm_model.control.torque_control import TorqueController

RECOVERY = 0.2
"""s in which the motion comes back to its full speed."""
SHARE = 0.95
"""Of the limits, planned with: the rest is for errors of the model and for feedback."""


class TimeScaling:
    """Runs ``demand`` through ``controller`` no faster than ``limits`` (n,) N m (N) allow; called every ``period`` s.

    ``reference``: positions demanded so far, one (n,) a tick.
    """

    def __init__(
        self,
        controller: TorqueController,
        demand: Callable[[float], Reference],
        limits: Array,
        *,
        period: float,
    ) -> None:
        if not (np.asarray(limits) > 0).all():
            raise InputError("limits", "must be positive, one for each joint")
        self.controller, self.demand, self.limits = controller, demand, SHARE * np.asarray(limits, float)
        self.period = period
        self.place, self.speed = 0.0, 1.0  # s and sigma
        self.reference: list[Array] = []

    def torque(self, q: Array, qd: Array, reference: Reference) -> Array:
        """(n,) joint torque; ``reference``, the demand at its own pace, is not looked at."""
        along = self.demand(self.place)
        base = Reference(along.q, self.speed * along.qd, self.speed**2 * along.qdd)
        tau = self.controller.torque(q, qd, base)
        inertial = self.controller.torque(q, qd, Reference(base.q, base.qd, base.qdd + along.qd)) - tau
        x = self._pace(tau, inertial)
        self.reference.append(along.q)
        self.place += self.period * (self.speed + self.period * x / 2)
        self.speed = min(max(self.speed + self.period * x, 0.0), 1.0)
        return tau + x * inertial

    def observe(self, q: Array, qd: Array, applied: Array) -> None:
        """What the drives gave, for the controller."""
        self.controller.observe(q, qd, applied)

    def _pace(self, tau: Array, inertial: Array) -> float:
        """x within what one tick can stop or bring to full speed, and within the limits if possible."""
        low, high = -self.speed / self.period, (1.0 - self.speed) / self.period
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(-self.limits - tau) / inertial, (self.limits - tau) / inertial])
        bears = np.abs(inertial) > 1e-9
        low = max(low, float(np.max(ends.min(axis=0), where=bears, initial=low)))
        high = min(high, float(np.min(ends.max(axis=0), where=bears, initial=high)))
        reference = (1.0 - self.speed) / RECOVERY
        return float(np.clip(reference, low, high)) if low <= high else -self.speed / RECOVERY
