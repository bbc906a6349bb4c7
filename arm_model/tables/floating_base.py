"""A floating base: the vehicle that carries an arm, with the water round it, its thrusters and its station keeping.

Frames: the body frame is fixed to the vehicle, x forward, y left, z up (any right-handed frame does); the arm's
``base`` is the pose of link frame 0 in it. The world frame is at rest; gravity is given in it. Everything with six
entries has the order surge, sway, heave, roll, pitch, yaw: x, y, z of a velocity or force (m/s, N), then about x, y, z
of a rate or moment (rad/s, N m), in the body frame about its origin (Fossen, Handbook of Marine Craft Hydrodynamics
and Motion Control, 2nd ed. 2021, chapters 3 to 8).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, model_validator
from pydantic.dataclasses import dataclass

from arm_io.types import Array
from arm_model.tables.fields import STRICT, NotNegative, Positive, Vector

Six = tuple[float, float, float, float, float, float]
SixNotNegative = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]
SixPositive = tuple[Positive, Positive, Positive, Positive, Positive, Positive]
NONE: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

DEGREES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Names of the six degrees of freedom, in the order of everything with six entries."""


def _matrix(value: Any) -> Any:
    """Six numbers are the diagonal of a 6 x 6 matrix."""
    if isinstance(value, list | tuple) and len(value) == 6 and all(isinstance(v, int | float) for v in value):
        return [[v if row == column else 0.0 for column in range(6)] for row, v in enumerate(value)]
    return value


Matrix6 = Annotated[tuple[Six, Six, Six, Six, Six, Six], BeforeValidator(_matrix)]
NO_MASS: Matrix6 = (NONE, NONE, NONE, NONE, NONE, NONE)


@dataclass(frozen=True, config=STRICT)
class Thruster:
    """One thruster.

    position (3,) m and direction (3,) of its force for a positive demand, body frame; limits (2,) N of its demand.
    gain: thrust over demanded thrust, 1 of a sound one, 0 of a dead one. time_constant s: of the thrust behind its
    demand, 0: none. forward, reverse: share of that thrust for positive and negative demands, 1 of a sound one.
    dead_zone N: demands of this size give nothing, larger ones that much less (``arm_model.moving_base.thrust_of``).
    """

    position: Vector
    direction: Vector
    limits: tuple[float, float]
    gain: float = 1.0
    time_constant: NotNegative = 0.0
    forward: float = 1.0
    reverse: float = 1.0
    dead_zone: NotNegative = 0.0
    name: str = ""

    @model_validator(mode="after")
    def _pushes(self) -> Thruster:
        if np.linalg.norm(self.direction) < 1e-9:
            raise ValueError("direction: must not be zero")
        if self.limits[0] >= self.limits[1]:
            raise ValueError("limits: the lower is not below the upper")
        return self


@dataclass(frozen=True, config=STRICT)
class StationKeeping:
    """Controller of the base: holds the pose at which a simulation starts.

    On the error e of position (body frame) and attitude (rotation vector) and on the velocity v, per degree of freedom:

        wrench = M (w^2 e - 2 zeta w v) + integral_rate M w^2 int e dt (+ the arm's reaction)

    M the diagonal of mass, added mass and arm at its zero pose. The wrench is distributed to the thrusters by the
    pseudo-inverse of their allocation matrix; their limits cut it. Evaluated at every servo tick.
    """

    natural_frequency: SixPositive  # rad/s
    damping_ratio: Positive = 1.0
    integral_rate: NotNegative = 0.0  # 1/s
    feedforward: NotNegative = 0.0  # share of the wrench that the arm's demanded motion takes which is added
    inertia: SixPositive | None = None  # kg, kg m2: M; absent: of the model as described


@dataclass(frozen=True, config=STRICT)
class FloatingBase:
    """The vehicle: a rigid body in water at rest.

    mass kg, com (3,) m, inertia (xx, yy, zz, xy, yz, xz) kg m2 about the com, as those of a link, body frame.
    added_mass (6, 6) kg, kg m, kg m2, symmetric (or its diagonal); linear_drag N s/m, N m s/rad and quadratic_drag
    N s2/m2, N m s2/rad2 against the velocity of each degree of freedom; displaced_mass kg of water, whose weight acts
    upwards at buoyancy_centre (3,) m.
    """

    mass: Positive
    inertia: Six
    kind: Literal["floating"] = "floating"
    com: Vector = (0.0, 0.0, 0.0)
    added_mass: Matrix6 = NO_MASS
    linear_drag: SixNotNegative = NONE
    quadratic_drag: SixNotNegative = NONE
    displaced_mass: NotNegative = 0.0
    buoyancy_centre: Vector = (0.0, 0.0, 0.0)
    thruster: tuple[Thruster, ...] = ()
    controller: StationKeeping | None = None

    @model_validator(mode="after")
    def _belongs_together(self) -> FloatingBase:
        added = np.array(self.added_mass)
        if np.abs(added - added.T).max() > 1e-3 * max(np.abs(added).max(), 1e-12):
            raise ValueError("added_mass: must be symmetric (within 0.1 % of its largest entry)")
        total = np.linalg.eigvalsh((added + added.T) / 2)
        if total[0] < -1e-9 * max(total[-1], 1e-12):
            raise ValueError("added_mass: has a negative eigenvalue; its kinetic energy must not be negative")
        if self.controller is not None and not self.thruster:
            raise ValueError("controller: needs at least one [[base.thruster]]")
        return self

    @property
    def added(self) -> Array:
        """(6, 6) added mass, symmetric."""
        matrix = np.array(self.added_mass, float)
        return np.asarray((matrix + matrix.T) / 2)

    @property
    def allocation(self) -> Array:
        """(6, thrusters) wrench on the base, body frame, per N of each thruster."""
        columns = []
        for thruster in self.thruster:
            direction = np.array(thruster.direction) / np.linalg.norm(thruster.direction)
            columns.append(np.concatenate([direction, np.cross(thruster.position, direction)]))
        return np.array(columns).reshape(-1, 6).T
