"""Momentum observer: computed torque, and an observer that estimates and cancels whatever the model leaves out.

The generalised momentum p = M(q) q' of the modelled arm changes by p' = tau + M' q' - h(q, q') - g(q) - friction + d,
where d is the torque of all that is not in the model: the water's drag and added mass, a payload, wrong friction. With

    r = K (p - p(0) - int (tau + M' q' - h - g - friction + r) dt)       r' = K (d - r)

r is d through a low-pass of bandwidth K, without differentiating a velocity (De Luca and Mattone, "Actuator failure
detection and isolation using generalized momenta", ICRA 2003). The drives are commanded tau - r. tau in the observer is
what the drives gave, cut by their limits.

What it guarantees where motions are slow against the sampling period T:

* r follows d with r' = K (d - r), sampled r + K T (d - r), at all times: limits that cut the torque do not wind it up,
  since what they cut is not taken for a disturbance. K T must be below 1.
* While no limit cuts, each joint's error obeys e'' + 2 zeta w e' + w^2 e = -(M^-1 (d - r))_j: a constant disturbance
  leaves no error, one that changes is felt with d'/K.
* While a limit cuts, nothing is promised of the error, by this or any controller at the demanded pace: the demand has
  to slow down (``arm_model.control.time_scaling``).

Added mass that the model lacks is in d as -Ma q''; that of the thesis's arm is three times the links' own, and is
borne.
"""

from __future__ import annotations

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.control.computed_torque import ComputedTorque, Reference
from arm_model.rigid_body.numeric import drive_mass_matrix
from arm_model.system.dynamics import inverse_dynamics

STEP = 1e-5
"""s over which the change of the mass matrix along the motion is differenced; the error is of its square."""


class MomentumObserver:
    """Computed torque less the observed disturbance.

    ``bandwidth`` K 1/s; ``period`` s between two calls of ``torque``.
    """

    def __init__(self, computed: ComputedTorque, *, bandwidth: float, period: float) -> None:
        if not 0 < bandwidth * period < 1:
            raise InputError("bandwidth", f"times the period is {bandwidth * period:g}; expected between 0 and 1")
        self.computed, self.bandwidth, self.period = computed, bandwidth, period
        self.disturbance = np.zeros(len(computed.arm))
        """(n,) N m (N): r as it was observed last."""
        self._integral: Array | None = None

    def torque(self, q: Array, qd: Array, reference: Reference) -> Array:
        """(n,) joint torque, N m (N), that no limit has cut yet."""
        momentum = self._momentum(q, qd)
        if self._integral is None:
            self._integral = momentum
        self.disturbance = self.bandwidth * (momentum - self._integral)
        return self.computed.torque(q, qd, reference) - self.disturbance

    def observe(self, q: Array, qd: Array, applied: Array) -> None:
        """What the drives give until the next call, (n,) N m, at the state of the last."""
        assert self._integral is not None, "torque() is called before observe()"
        self._integral = self._integral + self.period * (applied + self._bias(q, qd) + self.disturbance)

    def _momentum(self, q: Array, qd: Array) -> Array:
        return np.asarray(drive_mass_matrix(self.computed.arm, q[None])[0] @ qd)

    def _bias(self, q: Array, qd: Array) -> Array:
        """M' q' - h - g - friction, with what water the model has."""
        ahead, behind = drive_mass_matrix(self.computed.arm, np.stack([q + STEP * qd, q - STEP * qd]))
        state = q[None], qd[None], np.zeros((1, len(q)))
        known = inverse_dynamics(self.computed.arm, *state)[0]
        return np.asarray((ahead - behind) @ qd / (2 * STEP) - known)
