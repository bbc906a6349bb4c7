"""What turns the joints besides the recorded angle.

Effects that only tracked points show, linear in their parameters, q + D(q) c.

Which effects, with which parameters, units and laws: ``arm_model.effects``, those observed by
``Instrument.CALIBRATION``. A coupling is one candidate for every joint that may drive it. Constants are left to the
joint's theta. Which of them are real is decided on points that the fit has not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model.effects import CATALOGUE, Effect, Excitation, Instrument, Signals, Values
from identification.kinematics.models.chain import Gravity


@dataclass(frozen=True)
class Extension:
    """One candidate: its name, the joint it turns (from 1; None: all), and for couplings the joint that drives it."""

    name: str
    joint: int | None = None
    by: int | None = None

    @property
    def definition(self) -> Effect:
        """What the catalogue says of it."""
        return CATALOGUE[self.name]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(p.name for p in self.definition.linear)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of its parameters."""
        return tuple(p.unit for p in self.definition.linear)

    @property
    def scales(self) -> tuple[float, ...]:
        """Prior deviations: generous for real arms."""
        return tuple(p.tracker_prior or 0.0 for p in self.definition.linear)

    def __str__(self) -> str:
        place = "" if self.joint is None else f" of joint {self.joint}"
        return self.name + place + ("" if self.by is None else f" by joint {self.by}")


def candidates(moving: Sequence[int], prismatic: Sequence[bool], *, gravity: bool, velocity: bool) -> list[Extension]:
    """What could be there, for the joints (from 1) that move.

    Couplings between neighbours, and from 4 to 6 of a wrist.
    """
    turning = [j for j in moving if not prismatic[j - 1]]
    out = []
    for effect in CATALOGUE.values():
        if Instrument.CALIBRATION not in effect.observed_by:
            continue
        if effect.late is not None:
            out += [Extension(effect.name)] if velocity else []
        elif effect.driven:
            pairs = [(j, k) for j in turning for k in turning if j == k + 1 or (j, k) == (6, 4)]
            out += [Extension(effect.name, j, by=k) for j, k in pairs]
        elif gravity or effect.excited_by is not Excitation.GRAVITY:
            relative = all(p.unit == "1" for p in effect.linear)
            out += [Extension(effect.name, j) for j in (moving if relative else turning)]
    return out


def deflections(extensions: Sequence[Extension], q: Array, *, velocity: Array | None, gravity: Gravity | None) -> Array:
    """(N, joints, parameters): how far each parameter turns each joint, per unit; q and velocity (N, joints)."""
    n, joints = q.shape
    holding = any(e.definition.excited_by is Excitation.GRAVITY for e in extensions)
    if holding and gravity is None:
        raise ValueError("the gravity torque is missing")
    torque = gravity(q) if holding and gravity is not None else np.zeros_like(q)
    columns = []
    for extension in extensions:
        effect, j = extension.definition, (extension.joint or 1) - 1
        seen = Signals(q=q[:, j], load=torque[:, j], driver=q[:, (extension.by or 1) - 1])
        for name in extension.parameters:
            unit = Values({other: float(other == name) for other in extension.parameters})
            column = np.zeros((n, joints))
            if effect.bend is not None:
                column[:, j] = effect.bend(unit, seen)
            elif effect.late is not None and velocity is not None:
                column = -float(effect.late(unit, seen)) * velocity
            columns.append(column)
    return np.stack(columns, axis=2) if columns else np.zeros((n, joints, 0))


def prior_scales(extensions: Sequence[Extension]) -> Array:
    """Prior deviations of all parameters, in order."""
    return np.array([s for e in extensions for s in e.scales], float)
