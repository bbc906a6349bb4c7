"""Effects by which a joint turns otherwise than its recorded angle says: q + D(q) c, linear in their parameters c.

Only tracked points show them.

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
from identification.kinematics.data.recordings import Gravity


@dataclass(frozen=True)
class Extension:
    """One candidate: its name, the joint it turns (from 1; None: all), the joint that drives it or link that weighs."""

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
        driver = "link" if self.definition.excited_by is Excitation.GRAVITY else "joint"
        return self.name + place + ("" if self.by is None else f" by {driver} {self.by}")


def candidates(
    moving: Sequence[int],
    prismatic: Sequence[bool],
    *,
    gravity: Gravity | None,
    velocity: bool,
    coupled: Sequence[tuple[int, int]] = (),
) -> list[Extension]:
    """What could be there, for the joints (from 1) that move.

    Couplings between neighbours, from 4 to 6 of a wrist, and what is ``coupled`` (joint, by) anyway, for its error.
    Sag by the gravity torque where the model has masses, else by how every link behind the joint inclines.
    """
    turning = [j for j in moving if not prismatic[j - 1]]
    out = []
    for effect in CATALOGUE.values():
        if Instrument.CALIBRATION not in effect.observed_by:
            continue
        if effect.late is not None:
            out += [Extension(effect.name)] if velocity else []
        elif effect.excited_by is Excitation.GRAVITY:
            if gravity is not None and effect.driven is not gravity.weighed:
                behind = range(1, len(prismatic) + 1) if effect.driven else [None]
                out += [Extension(effect.name, j, k) for j in turning for k in behind if k is None or k >= j]
        elif effect.driven:
            pairs = [(j, k) for j in turning for k in turning if j == k + 1 or (j, k) in {(6, 4), *coupled}]
            out += [Extension(effect.name, j, by=k) for j, k in pairs]
        else:
            relative = all(p.unit == "1" for p in effect.linear)
            out += [Extension(effect.name, j) for j in (moving if relative else turning)]
    return out


def deflections(extensions: Sequence[Extension], q: Array, *, velocity: Array | None, gravity: Gravity | None) -> Array:
    """(N, joints, parameters): how far each parameter turns each joint, per unit; q and velocity (N, joints)."""
    n, joints = q.shape
    sagging = [e for e in extensions if e.definition.excited_by is Excitation.GRAVITY]
    if sagging and gravity is None:
        raise ValueError("the gravity torque is missing")
    torque, levels = np.zeros_like(q), {}
    if sagging and gravity is not None:
        levels = {e.by: gravity.levels(q, e.by) for e in sagging if e.by is not None}
        torque = gravity.torque(q) if any(e.by is None for e in sagging) else torque
    columns = []
    for extension in extensions:
        effect, j = extension.definition, (extension.joint or 1) - 1
        along, across = levels[extension.by][:, j].T if extension in sagging and extension.by else (0.0, 0.0)
        by = q[:, (extension.by or 1) - 1]
        seen = Signals(q=q[:, j], load=torque[:, j], driver=by, along=along, across=across)
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
    """(e,) prior standard deviations of all parameters, in order, in their units."""
    return np.array([s for e in extensions for s in e.scales], float)
