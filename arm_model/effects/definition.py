"""What an effect is: one definition that serves simulation, estimation, plot labels and report equations.

The law of an effect is written once, with the functions of ``arm_model.rigid_body.scalar``: called with numpy arrays it evaluates recorded data, with
nodes of the expression tape it becomes part of the compiled simulation, with sympy symbols it becomes the printed equation.

An effect has exactly one law, and which one says where in the chain it sits:

torque      torque(p, s): what the drive must provide in addition, N m (N) at the joint. With ``rate`` it has an internal state
            ``s.state`` whose rate is rate(p, s); at standstill the state is 0.
deflection  deflection(p, s): motor angle (over gear) minus link angle, rad (m), as a function of the transmitted torque ``s.load`` or
            of the motor angle; ``spring(p, s)`` is the transmitted torque over ``s.twist`` and ``s.twist_rate`` for the two-mass
            simulation of elastic transmissions (None: the relation is kinematic, simulated as it stands).
angle       angle(p, s): added to the motor angle over gear that the instrument records, rad (m).
current     current(p, s): added to the motor current that the instrument records, A.
delay       delay(p, s): s by which the recorded currents are late against the recorded angles.
change      change(arm, joint, p): another arm; for effects that are wrong numbers in the description.
coupling    parameters named cij: turn of axis i for a turn of motor j, in the relation link angles = (1 + C) motor angles.
bend        bend(p, s): rad by which the link hangs away from its joint's angle where a tracker looks; ``s.load`` is the torque that holds
            the joint against gravity.
late        late(p, s): s by which tracked points are late against the recorded angles.
stray       stray(p, s): m by which a tracked point is wrong, in any direction; ``s.state`` is a number in 0..1 drawn for its row.
limit       limit(p, s): the largest magnitude of motor current that the drive gives, A.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Place(StrEnum):
    """Where in the chain from motor to file an effect sits."""

    MECHANICS = "mechanics"
    TRANSMISSION = "transmission"
    SENSING = "sensing"
    TIMING = "timing"
    GEOMETRY = "geometry"


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect. ``linear``: the law is proportional to it (all linear ones together, others held).

    typical: magnitudes of a Puma-sized geared arm, in ``unit``; where a search for a nonlinear one begins and ends.
    """

    name: str
    unit: str
    typical: tuple[float, float]
    linear: bool
    meaning: str
    signed: bool = False  # may be negative
    whole: bool = False  # an integer


@dataclass(frozen=True)
class Signals:
    """What a law may look at; numbers, arrays of one shape, tape nodes or symbols alike. SI, at the joint.

    q, v, a       link angle, speed, acceleration; rad (m) and per second
    motor         angle of the motor itself: abs(gear) times the motor angle over gear ratio; rad
    sign          smooth sign of the speed, v / sqrt(v^2 + sign_velocity^2)
    load          torque that the gear transmits to the link, N m (N)
    coulomb       the model's own Coulomb friction in the present direction, N m (N), not negative
    current       motor current, A
    torque        actuator torque abs(gear) k i, N m (N)
    t             time since the start of the recording, s
    state         internal state of the effect, 0 at the start
    twist, twist_rate   motor angle over gear minus link angle, and its rate
    """

    q: Any = 0.0
    v: Any = 0.0
    a: Any = 0.0
    motor: Any = 0.0
    sign: Any = 0.0
    load: Any = 0.0
    coulomb: Any = 0.0
    current: Any = 0.0
    torque: Any = 0.0
    t: Any = 0.0
    state: Any = 0.0
    twist: Any = 0.0
    twist_rate: Any = 0.0


class Values(dict[str, Any]):
    """Parameter values by name, readable as attributes: ``p.coulomb``."""

    def __getattr__(self, name: str) -> Any:
        return self[name]


Law = Callable[[Values, Signals], Any]


@dataclass(frozen=True)
class Effect:
    """One effect of the vocabulary. ``equation`` is what a report prints; the laws are described in the module's docstring.

    per_joint        False: it belongs to the arm (or the instrument) as a whole
    shows            what a person sees in the residual
    confused_with    effects that a recording may fail to tell from it, each with what separates them
    """

    name: str
    place: Place
    parameters: tuple[Parameter, ...]
    equation: str
    shows: str
    confused_with: dict[str, str]
    per_joint: bool = True
    torque: Law | None = None
    rate: Law | None = None
    deflection: Law | None = None
    spring: Law | None = None
    angle: Law | None = None
    current: Law | None = None
    delay: Law | None = None
    limit: Law | None = None
    bend: Law | None = None
    late: Law | None = None
    stray: Law | None = None
    change: Callable[[Any, int | None, Values], Any] | None = None
    coupling: bool = False
    cylinder: bool = False  # it acts along the link's cylinder, and wants one in the model
    link_side: bool = False  # a torque on the link, behind a two-mass transmission; else it acts on the motor

    @property
    def linear(self) -> tuple[Parameter, ...]:
        """Parameters that can be estimated as coefficients of columns."""
        return tuple(p for p in self.parameters if p.linear)

    @property
    def nonlinear(self) -> tuple[Parameter, ...]:
        """Parameters that have to be searched for."""
        return tuple(p for p in self.parameters if not p.linear)
