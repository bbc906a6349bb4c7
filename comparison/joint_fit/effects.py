"""Effects beyond the model whose change is looked for: springs, elastic gears, gaps, ripples, the arm out of place.

Ripples are those that stand out. Out of place is an arm whose base is tilted, or whose encoders have other zeros.
Each is columns of the joint fit: the torque of all joints for a unit of each coefficient, by the law of the catalogue.
All sides share its value, and its change is a hypothesis like any other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE, Effect, Values, units
from arm_model.system import mass_matrix_along
from identification.preprocessing.signals import Motion

STIFFNESSES = (1e3, 4e3, 2e4, 2e5)
"""N m/rad (N/m) at which an elastic gear is tried, and twice the last as often as its link swings below ``STIFF``."""
STIFF = 15.0
"""Hz at which a link swings on an elastic gear that is above every motion: a stiffer one is the last, in proportion."""
DAMPING_RATIO = 0.1
"""Of an elastic gear with its link: more, and its twist would be as late as currents that are read at another time."""
CONTACT = {"contact_stiffness": 1e5, "contact_damping": 80.0}
"""N m/rad (N/m) and N m s/rad (N s/m) where a gap is closed: stiff, so that it is the gap alone that shows."""
HALF_GAPS = (5e-4, 2e-3)
"""rad (m) at which a gap is tried: what it does is in proportion, but for the time in which the link crosses it."""
NEAR = 0.1
"""Relative difference of the orders of two ripples of which one looks like the other."""


@dataclass(frozen=True)
class Added:
    """One effect at one joint (from 1), or of the whole arm (None), with its nonlinear parameters ``held``.

    amplitude  of a ripple: the linear parameter that it has; "": the effect's first
    tries      number of alternatives from which it was chosen by the data
    """

    effect: str
    joint: int | None
    held: Mapping[str, float] = field(default_factory=dict)
    amplitude: str = ""
    tries: int = 1

    @property
    def key(self) -> tuple[object, ...]:
        """Equal of those that have the same columns."""
        return self.effect, self.joint, tuple(sorted(self.held.items())), self.amplitude

    def same(self, other: Added) -> bool:
        """Whether both have the same columns."""
        return self.key == other.key

    @property
    def wave(self) -> bool:
        """Whether it is a ripple."""
        return self.definition.wave

    @property
    def placed(self) -> bool:
        """Whether it is an error of placement: of the base, or of the zero of an encoder."""
        return self.definition.change is not None

    @property
    def timed(self) -> bool:
        """Whether it is a delay of the currents."""
        return self.definition.delay is not None

    @property
    def elastic(self) -> bool:
        """Whether it is an elastic gear, at a stiffness."""
        return self.effect == "joint_compliance"

    def stiffer(self, by: float) -> Added:
        """The elastic gear at ``by`` times the stiffness, of the same damping ratio."""
        held = {"stiffness": self.held["stiffness"] * by, "damping": self.held["damping"] * math.sqrt(by)}
        return replace(self, held=held)

    def near(self, other: Added) -> bool:
        """Whether both are ripples of one joint that a travel of one turn hardly distinguishes."""
        if not (self.wave and other.wave) or self.joint != other.joint:
            return False
        return abs(self.held["order"] / other.held["order"] - 1.0) < NEAR

    @property
    def definition(self) -> Effect:
        """The effect as the catalogue defines it."""
        return CATALOGUE[self.effect]

    @property
    def units(self) -> list[Values]:
        """Parameter values, one set per column."""
        if self.definition.wave:
            return units(self.definition, self.held, self.amplitude)
        names = [p.name for p in self.definition.parameters]
        if self.placed:
            return [Values(dict.fromkeys(names, 0.0) | {name: 1.0}) for name in names]
        # a spring relaxed at one angle: relaxed at another, it adds a constant torque, which friction has as well
        return [Values(dict.fromkeys(names, 0.0) | {names[0]: 1.0} | dict(self.held))]


SKEW = Added("time_skew", None)
"""Currents that are read later or earlier than the angles."""


def always(arm: Arm, motions: Sequence[Motion]) -> list[Added]:
    """The tilt of the base; zeros, springs, elastic gears and gaps of every joint, but those that the model has."""
    centre = np.mean([arm.link_angles(motion.q).mean(axis=0) for motion in motions], axis=0)
    modelled = {(term.name, term.joint) for term in arm.effects}
    inertia = np.mean([np.mean(own_inertia(arm, motion), axis=0) for motion in motions], axis=0)
    effects = [Added("base_tilt", None), SKEW]
    for joint in range(1, len(arm) + 1):
        effects.append(Added("joint_zero_offset", joint))
        effects.append(Added("gravity_spring", joint, {"rest_angle": float(centre[joint - 1])}))
        elastic = _elastic(max(float(inertia[joint - 1]), 0.0))
        effects += [Added("joint_compliance", joint, held, tries=len(elastic)) for held in elastic]
        gaps = [{"half_gap": gap, **CONTACT} for gap in HALF_GAPS]
        effects += [Added("backlash", joint, held, tries=len(gaps)) for held in gaps]
    # delays of the model are corrected in the readings
    return [one for one in effects if one == SKEW or (one.effect, one.joint) not in modelled]


def _elastic(inertia: float) -> list[dict[str, float]]:
    """Stiffness and damping at which an elastic gear is tried, of links of this inertia, kg m2 (kg)."""
    stiffnesses = list(STIFFNESSES)
    while stiffnesses[-1] < (2.0 * np.pi * STIFF) ** 2 * inertia:
        stiffnesses.append(2.0 * stiffnesses[-1])
    return [{"stiffness": k, "damping": 2.0 * DAMPING_RATIO * math.sqrt(k * inertia)} for k in stiffnesses]


def own_inertia(arm: Arm, motion: Motion) -> Array:
    """(m, J) kg m2 (kg) of the links about each joint, the others at rest."""
    return np.asarray(mass_matrix_along(arm, motion.q).diagonal(axis1=1, axis2=2))
