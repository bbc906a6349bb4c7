"""Using a calibration: where the arm really is, which angles really reach a pose, and what to command instead.

Off-line programming plans with the nominal model. To have the real arm reach what was planned, command joint targets
whose pose, by the calibrated model, is the planned one (Veitschegger and Wu, IEEE J-RA 4(1), 1988, "pose correction").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import forward, jacobian
from identification.kinematics.data.recordings import Gravity
from identification.kinematics.estimation.extensions import Extension, deflections


@dataclass(frozen=True)
class Corrected:
    """A calibrated arm with what turns its joints besides the commanded angle.

    arm        calibrated geometry
    extensions with their parameters (all of them, in order); delays do not matter at rest and are ignored
    gravity    joint torques that hold the arm, where sag is among the extensions
    """

    arm: Arm
    extensions: tuple[Extension, ...] = ()
    values: tuple[float, ...] = ()
    gravity: Gravity | None = None

    def bent(self, q: Array) -> Array:
        """Joint angles (N, joints) that the links really have at recorded or commanded angles q (N, joints)."""
        q = self.arm.link_angles(q)
        if not self.extensions:
            return q
        return q + deflections(self.extensions, q, velocity=None, gravity=self.gravity) @ np.array(self.values)


def corrected_forward(model: Corrected, q: ArrayLike) -> Array:
    """(N, 4, 4) poses of the tool in the base frame at joint angles q (N, joints), arm at rest."""
    return forward(model.arm, model.bent(np.atleast_2d(np.asarray(q, float))))


def corrected_inverse(model: Corrected, pose: ArrayLike, start: ArrayLike) -> Array:
    """(joints,) angles whose ``corrected_forward`` is ``pose`` (4, 4), near ``start`` (joints,).

    With fewer than six joints only the position is reached. InputError if no solution is found.
    """
    pose, q = np.asarray(pose, float), np.array(start, float)
    rows = 6 if len(model.arm) >= 6 else 3
    damping = 1e-9
    off = _error(corrected_forward(model, q)[0], pose)[:rows]
    for _ in range(100):
        if np.linalg.norm(off) < 1e-9:
            return q
        slope = (jacobian(model.arm, model.bent(q[None])[0]) @ model.arm.coupling_matrix)[
            :rows
        ]  # deflections change it by parts in a thousand
        step = slope.T @ np.linalg.solve(slope @ slope.T + damping * np.eye(rows), off)
        trial = q + np.clip(step, -0.3, 0.3)
        trial_off = _error(corrected_forward(model, trial)[0], pose)[:rows]
        if np.linalg.norm(trial_off) < np.linalg.norm(off):
            q, off, damping = trial, trial_off, max(damping / 10, 1e-15)
        else:
            damping = max(10 * damping, 1e-9)
    raise InputError("pose", f"cannot be reached from this start: {np.linalg.norm(off):.3g} (m, rad) are left")


def corrected_targets(nominal: Arm, model: Corrected, q: ArrayLike) -> Array:
    """(N, joints) angles to command instead of q (N, joints).

    The real tool is where the nominal arm would have it.

    InputError names the first target that the calibrated arm cannot reach.
    """
    q = np.atleast_2d(np.asarray(q, float))
    wanted = forward(nominal, nominal.link_angles(q))
    out = np.empty_like(q)
    for k, (pose, start) in enumerate(zip(wanted, q, strict=True)):
        try:
            out[k] = corrected_inverse(model, pose, start)
        except InputError as error:
            raise InputError(f"target {k + 1}", error.what) from None
    return out


def _error(reached: Array, wanted: Array) -> Array:
    turned = Rotation.from_matrix(wanted[:3, :3] @ reached[:3, :3].T).as_rotvec()
    return np.concatenate([wanted[:3, 3] - reached[:3, 3], turned])


def within_limits(arm: Arm, q: Array) -> Array:
    """(N,) bool: all joints of q (N, joints) within their limits."""
    low, high = limits_of(arm)
    return np.all((q >= low) & (q <= high), axis=1)


def limits_of(arm: Arm) -> tuple[Array, Array]:
    """Lower and upper joint limits (joints,); +-180 degrees or +-0.5 m where the model gives none."""
    default = [np.pi if j.revolute else 0.5 for j in arm.joints]
    pairs: Sequence[tuple[float, float]] = [j.limits or (-d, d) for j, d in zip(arm.joints, default, strict=True)]
    return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
