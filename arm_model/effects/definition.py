"""What an effect is: one definition that serves simulation, estimation, plot labels and report equations.

The law of an effect is written once, with the functions of ``arm_model.rigid_body.scalar``: called with numpy arrays it
evaluates recorded data, with nodes of the expression tape it becomes part of the compiled simulation, with sympy
symbols it becomes the printed equation.

An effect has exactly one law, and which one says where in the chain it sits (a gear ripple has two, one for each of its
amplitudes: an uneven wheel displaces the link, or binds):

torque      torque(p, s): what the drive must provide in addition, N m (N) at the joint. With ``rate`` it has an
            internal state ``s.state`` whose rate is rate(p, s); at standstill the state is 0.
deflection  deflection(p, s): motor angle (over gear) minus link angle, rad (m), as a function of the transmitted torque
            ``s.load`` or of the motor angle; ``spring(p, s)`` is the transmitted torque over ``s.twist`` and
            ``s.twist_rate`` for the two-mass simulation of elastic transmissions (None: the relation is kinematic,
            simulated as it stands).
angle       angle(p, s): added to the motor angle over gear that the instrument records, rad (m).
current     current(p, s): added to the motor current that the instrument records, A.
delay       delay(p, s): s by which the recorded currents are late against the recorded angles.
change      change(arm, joint, p): another arm; for effects that are wrong numbers in the description.
coupling    parameters named cij: turn of axis i for a turn of motor j, in the relation link angles = (1 + C) motor
            angles.
bend        bend(p, s): rad by which the link turns away from its joint's angle where a tracker looks; ``s.q`` is that
            angle, ``s.load`` the torque that holds the joint against gravity.
late        late(p, s): s by which tracked points are late against the recorded angles.
stray       stray(p, s): m by which a tracked point is wrong, in any direction; ``s.state`` is a number in 0..1 drawn
            for its row.
limit       limit(p, s): the largest magnitude of motor current that the drive gives, A.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import isfinite, sqrt
from typing import Any

import numpy as np

from arm_io.plain_data import LARGEST
from arm_model.effects.observation import Excitation, Instrument, Observation, Scale, Span


class Place(StrEnum):
    """Where in the chain from motor to file an effect sits."""

    MECHANICS = "mechanics"
    TRANSMISSION = "transmission"
    SENSING = "sensing"
    TIMING = "timing"
    GEOMETRY = "geometry"


SYSTEMATIC = 0.02
"""Relative error of a first-order column, as a share of the value estimated by it.

``Effect.model_error`` where more is known.
"""


def geometric(low: float, high: float, count: int) -> tuple[float, ...]:
    """``count`` values from low to high, each the same factor above the one before."""
    return tuple(float(value) for value in np.geomspace(low, high, count))


def integers(low: int, high: int) -> tuple[float, ...]:
    """All integers from low to high."""
    return tuple(float(value) for value in range(low, high + 1))


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect. ``linear``: the law is proportional to it (all linear ones together, others held).

    typical        magnitudes of a Puma-sized geared arm, in ``unit``
    signed         may be negative
    whole          an integer; of a wave, cycles per turn: an integer for turns of the motor
    search         values that a search begins with; (): it is a coefficient, is spanned, or is derived
    coarse         the recordings show little of it: it is one of its search values, and is not refined
    fixed          the recordings hardly show it: it stays at its first search value and is not reported
    span           why no search is needed: see ``Span``
    derived        follows from the joint where it is not given (``arm_model.system.step_size``); searched in closed
                   loop only
    inverse        the effect is largest where this is least
    most           largest magnitude that is physically admissible, and that a model file holds
    scale, shares  on an axis of any size and unit, the search is at these shares of that scale instead
    damping_ratios where the inertia that swings on a spring is known, the search is at these shares of the critical
                   damping of its ``stiffness`` instead
    own            0, or a value that the joint's own friction has: both are tried, and nothing between
    term           the next-order term of the law that it belongs to, 0 unless what the law leaves asks for it; "": it
                   belongs to the law itself
    term_share     of a coefficient of a term: largest share of what law and term explain that may be the term's. With
                   more, it is no next order, and another law is at work
    lasts          of a term of time: s until which the law is known to change, as long as the longest recording; from
                   then on it stays as it is
    chain          value of the kinematic chain that it changes: theta, alpha, a, d or beta of its joint
    tracker_prior  prior standard deviation where only tracked points show it, in ``unit`` (``inverse``: of its
                   reciprocal)
    noun           what a sentence calls it, with the place of its value as ``{}`` unless that comes last; "": its name
    """

    name: str
    unit: str
    typical: tuple[float, float]
    linear: bool
    meaning: str
    signed: bool = False
    whole: bool = False
    search: tuple[float, ...] = ()
    coarse: bool = False
    fixed: bool = False
    span: Span | None = None
    derived: bool = False
    inverse: bool = False
    most: float = LARGEST
    scale: Scale | None = None
    shares: tuple[float, ...] = ()
    damping_ratios: tuple[float, ...] = ()
    own: bool = False
    term: str = ""
    term_share: float = 0.0
    lasts: bool = False
    chain: str = ""
    tracker_prior: float | None = None
    noun: str = ""

    def erring(self, value: float) -> float:
        """What a relative error of the law is a share of, at a value: its size, and of a phase 1 rad.

        A wave that is wrong by a share of a sine, at any phase, is turned by as many radians.
        """
        return 1.0 if self.span is Span.PHASE else abs(value)

    def sized(self, size: str) -> str:
        """``a viscous friction of 10 N m s/rad``: the parameter at a size, in words."""
        noun = self.noun or self.name.replace("_", " ")
        words = noun.replace("{}", size) if "{}" in noun else f"{noun} of {size}"
        return f"{'an' if words[0] in 'aeiou' else 'a'} {words}"

    def in_words(self, value: float, unit: str) -> str:
        """``viscous 10 N m s/rad``; of an ``own`` share, what it is of the joint's friction in either direction."""
        if not self.own:
            return f"{self.name.replace('_', ' ')} {value:g}" + (f" {unit}" if unit != "1" else "")
        more, less = ("more", "less") if value > 0.0 else ("less", "more")
        return f"{100 * abs(value):.3g} % {more} while moving positive, as much {less} while moving negative"


@dataclass(frozen=True)
class Signals:
    """What a law may look at; numbers, arrays of one shape, tape nodes or symbols alike. SI, at the joint.

    q, v, a       link angle, speed, acceleration; rad (m) and per second
    motor         angle of the motor itself: abs(gear) times the motor angle over gear ratio; rad
    sign          smooth sign of the speed, v / sqrt(v^2 + sign_velocity^2)
    load          torque that the gear transmits to the link, N m (N)
    coulomb       the model's own friction in the present direction without its viscous part: Coulomb's and that of
                  its friction curve at this speed, N m (N)
    current       motor current, A
    torque        actuator torque abs(gear) k i, N m (N)
    t             time since the start of the recording, s
    warmer        temperature of the motor less that at which the model's friction holds, K; 0 where it is not known
    state         internal state of the effect, 0 at the start
    driver        angle of the joint whose number is the effect's parameter ``driver``; rad (m)
    along, across  how the weight of the link whose number is the parameter ``driver`` lies to the joint, -1 .. 1
                  (``arm_model.rigid_body.gravity_level``)
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
    warmer: Any = 0.0
    state: Any = 0.0
    driver: Any = 0.0
    along: Any = 0.0
    across: Any = 0.0
    twist: Any = 0.0
    twist_rate: Any = 0.0


class Values(dict[str, Any]):
    """Parameter values by name, readable as attributes: ``p.coulomb``."""

    def __getattr__(self, name: str) -> Any:
        return self[name]


Law = Callable[[Values, Signals], Any]


@dataclass(frozen=True, repr=False)
class Effect:
    """One effect of the vocabulary.

    ``equation`` is what a report prints; the laws are described in the module's docstring.

    leading          the equation where terms of next order, and values that the joint's own friction may have, are 0;
                     "": there are none
    per_joint        False: it belongs to the arm (or the instrument) as a whole
    shows            what a person sees in the residual
    confused_with    effects that a recording may fail to distinguish from it, each with what separates them
    observed_by      the instruments that show it, and how each does
    excited_by       what a joint must do for it to show
    aliases          effects that may as well be it, whatever is recorded; two that name each other have the same
                     columns
    special_cases    simpler effects of the catalogue that it contains
    separate_cases   special cases that together are causes of their own: where they explain as much, not this effect
    near_cases       simpler effects that it nearly contains, while poses or times differ little
    model_error      relative error of its first-order column
    link_parameters  its columns are this many barycentric parameters of its joint's link (of the last one, for the
                     whole arm): mass, first moments, inertia about the frame's origin; 0: they follow from its law
    body             effect of a link that has its columns where it is a body with an inertia of its own, not a point
    own_joint        a change of the description that only the current of its own joint shows
    driven           its law looks at ``s.driver``, or at how the weight of that link lies
    settable         of an effect that a person, or the day, may change between two recordings of one arm: what was done
    sparse           acts at a few instants of a recording: may also be judged by when these are
    near_rest        friction that differs from Coulomb's only where the joint turns or creeps: judged there as well
    rises_by         of friction near rest with a level: the effect by which it rises with the time at rest; it has the
                     velocity of this one, too
    directional      differs between the directions of motion, or is made up for by an effect that does
    friction         its torque depends on the velocity alone: part of the joint's friction, which opposes the motion as
                     a whole (``arm_model.effects.dissipation``)
    conditional      friction that depends on load or temperature: beside the joint's friction over speed
    """

    name: str
    place: Place
    parameters: tuple[Parameter, ...]
    equation: str
    shows: str
    confused_with: dict[str, str]
    leading: str = ""
    per_joint: bool = True
    observed_by: Mapping[Instrument, Observation] = field(default_factory=dict)
    excited_by: Excitation = Excitation.MOTION
    aliases: tuple[str, ...] = ()
    special_cases: tuple[str, ...] = ()
    separate_cases: tuple[str, ...] = ()
    near_cases: tuple[str, ...] = ()
    model_error: float = SYSTEMATIC
    link_parameters: int = 0
    body: str = ""
    own_joint: bool = False
    driven: bool = False
    settable: str = ""
    sparse: bool = False
    near_rest: bool = False
    rises_by: str = ""
    directional: bool = False
    friction: bool = False
    conditional: bool = False
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
    cylinder: bool = False  # it acts along the link's cylinder, and needs one in the model
    link_side: bool = False  # a torque on the link, behind a two-mass transmission; else it acts on the motor

    def __repr__(self) -> str:
        return f"<Effect {self.name}: {self.equation}; {', '.join(f'{p.name} {p.unit}' for p in self.parameters)}>"

    def __getitem__(self, name: str) -> Parameter:
        """The parameter of that name; KeyError where it has none."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(f"{self.name} has no parameter {name!r}")

    def admits(self, name: str, value: float) -> bool:
        """Whether a parameter can have this value: its sign, and no more than ``most``."""
        parameter = self[name]
        return isfinite(value) and (parameter.signed or value >= 0.0) and abs(value) <= parameter.most

    @property
    def linear(self) -> tuple[Parameter, ...]:
        """Parameters that can be estimated as coefficients of columns; without those of next-order terms."""
        return tuple(p for p in self.parameters if p.linear and not p.term)

    def sizes(self, amplitude: str = "") -> tuple[Parameter, ...]:
        """The linear parameters that coefficients stand for: all, or ``amplitude`` alone; of a wave never but one."""
        if amplitude:
            return (self[amplitude],)
        return self.linear if self.span is None else self.linear[:1]

    @property
    def nonlinear(self) -> tuple[Parameter, ...]:
        """Parameters that have to be searched for; without those of next-order terms."""
        return tuple(p for p in self.parameters if not p.linear and not p.term)

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the next-order terms of the law."""
        return tuple(dict.fromkeys(p.term for p in self.parameters if p.term))

    def of_term(self, term: str) -> Parameter:
        """The coefficient of a next-order term."""
        return next(p for p in self.parameters if p.term == term)

    def shown(self, instrument: Instrument, values: Mapping[str, float], unit: Mapping[str, str]) -> str:
        """What a person sees of it in an instrument's signal.

        ``values`` are its parameters (SI), with the ``unit`` of each at its joint.
        """
        shows = self.observed_by[instrument].shows or self.shows
        return shows if isinstance(shows, str) else shows(Values(values), unit)

    def damped(self, searched: Mapping[str, float], inertia: float) -> dict[str, float]:
        """First values of a search, that of a damping as its share of the critical one.

        inertia: kg m2 (kg) that swings on the spring of that ``stiffness``; 0: not known, they stay as they are.
        """
        values = dict(searched)
        for p in self.parameters if inertia > 0.0 else ():
            if p.damping_ratios and values[p.name] in p.search:
                ratio = p.damping_ratios[p.search.index(values[p.name])]
                values[p.name] = 2.0 * ratio * sqrt(values["stiffness"] * inertia)
        return values

    def lasting(self, term: str) -> Parameter | None:
        """Of a next-order term of time, the parameter that says how long it lasts; None: a term of something else."""
        return next((p for p in self.parameters if p.term == term and p.lasts), None)

    @property
    def screened(self) -> bool:
        """Found in raw rows or lags and taken out of the data before currents are compared."""
        return bool(self.observed_by) and set(self.observed_by) <= {Instrument.RAW, Instrument.LAG}

    @property
    def tracked_only(self) -> bool:
        """Acts where a tracker looks, and nowhere else."""
        return self.bend is not None or self.late is not None or self.stray is not None

    @property
    def span(self) -> Parameter | None:
        """The parameter by which the law spans a plane, if there is one."""
        return next((p for p in self.nonlinear if p.span is not None and p.span.values), None)

    def cycles(self, values: Mapping[str, float]) -> float:
        """Cycles of a wave per turn of the motor; 0 where it is no wave over the motor's angle."""
        return next((float(values[p.name]) for p in self.parameters if p.whole and p.name in values), 0.0)

    @property
    def gap(self) -> Parameter | None:
        """The parameter within which a transmission lets go of its link; None for a spring that does not."""
        return self.linear[0] if self.spring is not None and self.linear else None

    @property
    def unit_amplitude(self) -> bool:
        """Whether its columns are there as they are or not at all: nothing that it does is linear in a parameter."""
        return self.spring is not None or (not self.linear and self.delay is None and self.change is None)

    @property
    def wave(self) -> bool:
        """Whether it is a sine, with an amplitude and a phase."""
        return self.span is not None and self.span.span is Span.PHASE
