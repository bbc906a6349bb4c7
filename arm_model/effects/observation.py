"""How an effect is observed: by which instrument, against which variable, and what a joint must do for it to show."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import atan2, hypot
from typing import Any


class Instrument(StrEnum):
    """What shows an effect. Each is one measurement of ``diagnosis``."""

    CURRENT = "current"
    """Motor currents less those that the model expects along the measured motion."""
    SINGLE_AXIS = "single axis"
    """The same for one axis alone with a fine encoder, at the full rate."""
    RAW = "raw rows"
    """Single signals as recorded: lines, steps, values that pile up. No model is needed."""
    LAG = "lag"
    """Delay of the measured behind the expected currents, piece by piece."""
    DEMAND = "demand"
    """Motor angles less the setpoints of their own axes. No model is needed."""
    LINK_ENCODER = "link encoder"
    """Motor angle over gear less link angle, of joints with two encoders."""
    TRACKER = "tracker"
    """Points of a target on the last link, less where the kinematic model puts it."""
    CALIBRATION = "calibration"
    """The same points, while all geometric parameters of the arm are free (``armscope calibrate``)."""
    IDENTIFICATION = "identification"
    """Torques of recordings, while all parameters of the arm are free (``armscope identify``)."""
    CLOSED_LOOP = "closed loop"
    """Measured currents less those of the model's own closed loop on the same setpoints."""


class Variable(StrEnum):
    """What a residual is drawn against; of the joint that shows it."""

    POSITION = "position"
    MOTOR_ANGLE = "motor angle"
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    LOAD = "load torque"
    CURRENT = "current"
    CURRENT_RATE = "change of the current"


class Excitation(StrEnum):
    """What a joint must do for an effect to show."""

    MOTION = "motion"
    """Move, slowly and fast."""
    LOAD = "load"
    """Transmit torque."""
    GRAVITY = "gravity"
    """Hold different torques against gravity."""
    LOAD_REVERSAL = "load reversal"
    """Transmit torque that changes its sign."""
    CURRENT = "current"
    """Draw current."""
    SPEED = "speed"
    TEMPERATURE = "temperature"
    """Become warmer, or colder, by some kelvin, slowly and at speed."""
    ACCELERATION = "acceleration"


Words = Callable[[Any, Mapping[str, str]], str]
"""words(p, unit): a sentence part for parameter values ``p`` and the unit of each parameter at its joint."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """How one instrument shows an effect.

    against     the variable that shows it best
    shows       what a person sees in that instrument's signal; "": ``Effect.shows``
    aliases     effects that are the same to this instrument (to CURRENT: while the drives are on)
    of_arm      False: here it is an error of the instrument, which the model has no place for
    experiment  what would show it to this instrument, where recordings did not; "": any that has the instrument
    """

    against: Variable = Variable.POSITION
    shows: str | Words = ""
    aliases: tuple[str, ...] = ()
    of_arm: bool = True
    experiment: str = ""


class Span(StrEnum):
    """A nonlinear parameter for which the laws of all values lie in one plane.

    Columns at two values, or one further column, therefore replace a search.
    """

    PHASE = "phase"
    """a sin(x + phi) = c0 sin x + c1 sin(x + pi / 2): a = hypot(c0, c1), phi = atan2(c1, c0)."""
    SHIFT = "shift"
    """k (x - x0) = c0 x + c1 (x - 1): k = c0 + c1, x0 = c1 / k."""
    MOMENT = "moment"
    """m and m x are the coefficients c0 and c1: x = c1 / m."""
    INERTIA = "inertia"
    """The coefficient is an entry of the inertia about the frame's origin, the parameter the same about the centre."""

    @property
    def values(self) -> tuple[float, ...]:
        """Values of the parameter at which the law is evaluated for a column each; none for moments of mass."""
        return {Span.PHASE: (0.0, 1.5707963267948966), Span.SHIFT: (0.0, 1.0)}.get(self, ())

    def solve(self, one: float, other: float) -> tuple[float, float]:
        """Size and value of the parameter that two coefficients stand for."""
        if self is Span.PHASE:
            return hypot(one, other), atan2(other, one)
        size = one + other
        return size, other / size if size else 0.0


class Scale(StrEnum):
    """What the search of a parameter scales with on an axis of any size and unit."""

    SPEED = "largest speed"
    YIELD = "Coulomb friction over a share of the travel"
