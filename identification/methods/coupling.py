"""How much of what a motor-link pair leaves of one joint's torque is the coupling torque of the other links.

The pair knows its own joint only. What the others do to it, by their motion and by where they stand,

    tau_c = tau_j(q, q', q'') - tau_j(q with the others at their mean, their rates 0)

is exact for a known arm. Where the joints are not blocked, it is correlated with the pair's own columns, and the pair
takes it for inertia and friction (M. Abderrahim, "Modelling of Robotic Manipulators", thesis, Glasgow, section 5.3,
table 5.2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.system import rigid_torque_along
from identification.methods.motor_link import MotorLink, motor_link_of
from identification.preprocessing.signals import Motion


@dataclass(frozen=True)
class Coupling:
    """Of one joint (1-based): the pair as fitted, and with the coupling torque taken out before.

    torque (m,) N m (N): the coupling torque; by_joint: its rms that goes when joint k (1-based) alone is held still;
    residual_rms, residual_rms_without: of the torque, as fitted and without the coupling torque, N m (N); share: of the
    former's square that the coupling is.
    """

    joint: int
    as_fitted: MotorLink
    without: MotorLink
    torque: Array
    by_joint: dict[int, float]
    residual_rms: float
    residual_rms_without: float

    @property
    def share(self) -> float:
        """Share of the squared residual that is coupling torque."""
        return 1.0 - (self.residual_rms_without / self.residual_rms) ** 2

    def sentence(self) -> str:
        """The verdict for a person."""
        most = ", ".join(
            str(k)
            for k, rms in sorted(self.by_joint.items(), key=lambda one: -one[1])
            if rms > 0.1 * max(self.by_joint.values())
        )
        return (
            f"joint {self.joint}: {self.share:.0%} of the residual of the motor-link pair ({self.residual_rms:.2g} -> "
            f"{self.residual_rms_without:.2g} rms) is coupling torque of the other links, mostly of joint {most}, "
            "which biases the pair's inertia and friction"
        )


def coupling_torque(arm: Arm, motion: Motion, joint: int, *, held: tuple[int, ...] | None = None) -> Array:
    """(m,) torque added at ``joint`` by the motion of the other joints, or of those ``held`` (1-based)."""
    still = [k for k in range(len(arm)) if k != joint - 1] if held is None else [k - 1 for k in held]
    q, qd, qdd = motion.q.copy(), motion.qd.copy(), motion.qdd.copy()
    q[:, still] = motion.q[:, still].mean(axis=0)
    qd[:, still] = qdd[:, still] = 0.0
    moving = rigid_torque_along(arm, motion.q, motion.qd, motion.qdd)[:, joint - 1]
    return np.asarray(moving - rigid_torque_along(arm, q, qd, qdd)[:, joint - 1], float)


def coupling_at(arm: Arm, motion: Motion, joint: int, *, gravity: bool) -> Coupling:
    """The pair of ``joint`` (1-based) fitted to its torque, and to its torque less the coupling of the other links."""
    torque = coupling_torque(arm, motion, joint)
    as_fitted = motor_link_of(motion, joint - 1, gravity=gravity)
    alone = motion.torque.copy()
    alone[:, joint - 1] -= torque
    without = motor_link_of(replace(motion, torque=alone), joint - 1, gravity=gravity)
    by_joint = {
        k: float(np.sqrt(np.mean(coupling_torque(arm, motion, joint, held=(k,)) ** 2)))
        for k in range(1, len(arm) + 1)
        if k != joint
    }
    rms = [float(np.sqrt(np.mean(pair.fit.residual**2))) for pair in (as_fitted, without)]
    return Coupling(joint, as_fitted, without, torque, by_joint, *rms)
