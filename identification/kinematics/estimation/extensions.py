"""What turns the joints besides the recorded angle: deflections linear in their parameters, q + D(q) c.

    encoder_scale          q_j (1 + s): a wrong number of lines, gear ratio or belt          scale, dimensionless
    encoder_ripple         A sin(q_j) + B cos(q_j): eccentricity, once a turn of the joint   sine, cosine, rad
    transmission_coupling  c q_k on joint j: an axis driven through another                  ratio, dimensionless
    link_sag               -compliance x the torque that holds joint j against gravity       compliance, rad/(N m)
    tracker_latency        -delay x q' on all joints: points are later than the angles        delay, s

Constants are left to the joint's theta. Which of them are real is decided on points that the fit has not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.kinematics.models.chain import Gravity


@dataclass(frozen=True)
class Extension:
    """One candidate: its name, the joint it turns (from 1; None: all), and for couplings the joint that drives it."""

    name: str
    joint: int | None = None
    by: int | None = None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return _PARAMETERS[self.name]

    @property
    def units(self) -> tuple[str, ...]:
        """Units of its parameters."""
        return _UNITS[self.name]

    @property
    def scales(self) -> tuple[float, ...]:
        """Prior deviations: generous for real arms."""
        return _SCALES[self.name]

    def __str__(self) -> str:
        place = "" if self.joint is None else f" of joint {self.joint}"
        return self.name + place + ("" if self.by is None else f" by joint {self.by}")


_PARAMETERS = {
    "encoder_scale": ("scale",),
    "encoder_ripple": ("sine", "cosine"),
    "transmission_coupling": ("ratio",),
    "link_sag": ("compliance",),
    "tracker_latency": ("delay",),
}
_UNITS = {
    "encoder_scale": ("1",),
    "encoder_ripple": ("rad", "rad"),
    "transmission_coupling": ("1",),
    "link_sag": ("rad/(N m)",),
    "tracker_latency": ("s",),
}
_SCALES = {
    "encoder_scale": (0.05,),
    "encoder_ripple": (0.02, 0.02),
    "transmission_coupling": (0.05,),
    "link_sag": (1e-3,),
    "tracker_latency": (0.02,),
}


def candidates(moving: Sequence[int], prismatic: Sequence[bool], *, gravity: bool, velocity: bool) -> list[Extension]:
    """What could be there, for the joints (from 1) that move: couplings between neighbours, and from 4 to 6 of a wrist."""
    turning = [j for j in moving if not prismatic[j - 1]]
    out = [Extension("tracker_latency")] if velocity else []
    out += [Extension("link_sag", j) for j in turning] if gravity else []
    out += [Extension("encoder_scale", j) for j in moving]
    out += [Extension("encoder_ripple", j) for j in turning]
    pairs = [(j, k) for j in turning for k in turning if j == k + 1 or (j, k) == (6, 4)]
    out += [Extension("transmission_coupling", j, by=k) for j, k in pairs]
    return out


def deflections(extensions: Sequence[Extension], q: Array, *, velocity: Array | None, gravity: Gravity | None) -> Array:
    """(N, joints, parameters): how far each parameter turns each joint, per unit; q and velocity (N, joints)."""
    n, joints = q.shape
    torque = gravity(q) if gravity is not None and any(e.name == "link_sag" for e in extensions) else None
    columns = []
    for extension in extensions:
        j = (extension.joint or 1) - 1
        match extension.name:
            case "encoder_scale":
                turns = [q[:, j]]
            case "encoder_ripple":
                turns = [np.sin(q[:, j]), np.cos(q[:, j])]
            case "transmission_coupling":
                turns = [q[:, (extension.by or 1) - 1]]
            case "link_sag":
                if torque is None:
                    raise ValueError("link_sag wants the gravity torque")
                turns = [-torque[:, j]]
            case "tracker_latency":
                columns.append(np.zeros((n, joints)) if velocity is None else -velocity)
                continue
            case _:
                raise ValueError(f"no extension is called {extension.name!r}")
        for turn in turns:
            column = np.zeros((n, joints))
            column[:, j] = turn
            columns.append(column)
    return np.stack(columns, axis=2) if columns else np.zeros((n, joints, 0))


def prior_scales(extensions: Sequence[Extension]) -> Array:
    """Prior deviations of all parameters, in order."""
    return np.array([s for e in extensions for s in e.scales], float)
