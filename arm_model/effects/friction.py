"""Friction over speed and position; over load, temperature and time: ``conditional_friction``.

All laws are torques that oppose the motion; what the model's own viscous and Coulomb friction already says is not
repeated.
"""

from __future__ import annotations

from typing import Any

from arm_model.effects.definition import Effect, Parameter, Place, Signals, Values, geometric
from arm_model.effects.observation import Excitation, Instrument, Observation, Scale, Variable
from arm_model.rigid_body import scalar

AGAINST_VELOCITY = {
    Instrument.CURRENT: Observation(against=Variable.VELOCITY),
    Instrument.SINGLE_AXIS: Observation(against=Variable.VELOCITY),
}

WITH_TIME = "change with time"


def with_time(unit: str, typical: tuple[float, float]) -> tuple[Parameter, Parameter]:
    """The next-order term of friction that changes evenly while an arm is recorded, as a cold one that warms up."""
    return (
        Parameter(
            "change",
            unit,
            typical,
            True,
            "change per second of a recording",
            signed=True,
            term=WITH_TIME,
            # of friction that grows from zero, a constant explains three quarters and this term one quarter
            term_share=0.2,
        ),
        Parameter(
            "until",
            "s",
            (0.0, 600.0),
            False,
            "time after which it is constant: that of the longest recording",
            term=WITH_TIME,
            lasts=True,
            noun="end of its change",
        ),
    )


def changed(p: Values, s: Signals) -> Any:
    """By how much a coefficient has changed since the start of a recording."""
    return p.change * scalar.minimum(s.t, p.until)


VISCOUS_FRICTION = Effect(
    name="viscous_friction",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "viscous",
            "N m s/rad",
            (0.2, 10.0),
            True,
            "missing viscous coefficient, at the start of a recording",
            signed=True,
            noun="viscous friction",
        ),
        *with_time("N m/rad", (0.01, 1.0)),
    ),
    equation="tau = (B + b min(t, te)) q'",
    leading="tau = B q'",
    settable="not the same in all recordings",
    shows="error proportional to velocity",
    confused_with={"time_skew": "motion at two speeds", "hydrodynamic_drag": "motion at two speeds"},
    observed_by=AGAINST_VELOCITY,
    excited_by=Excitation.SPEED,
    directional=True,
    friction=True,
    torque=lambda p, s: (p.viscous + changed(p, s)) * s.v,
)

COULOMB_FRICTION = Effect(
    name="coulomb_friction",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "coulomb",
            "N m",
            (0.1, 15.0),
            True,
            "missing Coulomb friction, mean of both directions, at the start of a recording",
            signed=True,
            noun="Coulomb friction",
        ),
        Parameter(
            "skew",
            "1",
            (0.0, 0.5),
            False,
            "more while moving positive and less while moving negative, as a share: 0, or that of the joint's own "
            "friction, which has then grown in proportion",
            signed=True,
            own=True,
            noun="difference between directions",
        ),
        *with_time("N m/s", (0.01, 1.0)),
    ),
    equation="tau = (F + f min(t, te)) (1 + s sign(q')) sign(q')",
    leading="tau = F sign(q')",
    settable="not the same in all recordings",
    shows="a step where the velocity changes sign",
    confused_with={
        "presliding_friction": "reversals at different speeds",
        "backlash": "reversals at different speeds",
    },
    observed_by=AGAINST_VELOCITY,
    directional=True,
    friction=True,
    torque=lambda p, s: (p.coulomb + changed(p, s)) * (1 + p.skew * s.sign) * s.sign,
)

FRICTION_ASYMMETRY = Effect(
    name="friction_asymmetry",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "positive",
            "N m",
            (0.1, 8.0),
            True,
            "missing Coulomb friction while moving positive",
            signed=True,
            noun="friction asymmetry of {} in the positive direction",
        ),
        Parameter(
            "negative",
            "N m",
            (0.1, 8.0),
            True,
            "missing Coulomb friction while moving negative",
            signed=True,
            noun="friction asymmetry of {} in the negative direction",
        ),
        Parameter(
            "viscous_positive",
            "N m s/rad",
            (0.2, 10.0),
            True,
            "missing viscous coefficient, positive",
            signed=True,
            noun="viscous friction asymmetry of {} in the positive direction",
        ),
        Parameter(
            "viscous_negative",
            "N m s/rad",
            (0.2, 10.0),
            True,
            "missing viscous coefficient, negative",
            signed=True,
            noun="viscous friction asymmetry of {} in the negative direction",
        ),
    ),
    equation="tau = F+ + B+ q' for q' > 0, -F- + B- q' for q' < 0",
    shows="steps and slopes against velocity that differ between the two directions, an offset while moving",
    confused_with={"current_offset": "standstill with the drives off"},
    observed_by=AGAINST_VELOCITY,
    special_cases=("viscous_friction", "coulomb_friction", "current_offset"),
    # neither level nor slope of the friction differs between the directions then
    separate_cases=("viscous_friction", "current_offset"),
    directional=True,
    friction=True,
    torque=lambda p, s: (
        (p.positive * (s.sign + s.sign**2) + p.negative * (s.sign - s.sign**2)) / 2
        + (p.viscous_positive * (s.v + scalar.absolute(s.v)) + p.viscous_negative * (s.v - scalar.absolute(s.v))) / 2
    ),
)


def hump(p: Values, s: Signals) -> Any:
    """exp(-(q'/vs)^2): the share of the break-away friction that is left at a speed; vs is ``stribeck_velocity``."""
    return scalar.exp(-((s.v / p.stribeck_velocity) ** 2))


STRIBECK_FRICTION = Effect(
    name="stribeck_friction",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "breakaway", "N m", (0.05, 15.0), True, "friction above Coulomb's at rest", noun="break-away friction"
        ),
        Parameter(
            "stribeck_velocity",
            "rad/s",
            (0.01, 0.2),
            False,
            "velocity at which it has fallen to 1/e",
            search=geometric(0.01, 0.2, 6),
            scale=Scale.SPEED,
            shares=geometric(0.005, 0.4, 10),
        ),
    ),
    equation="tau = (Fs - Fc) exp(-(q'/vs)^2) sign(q')",
    shows="a hump at low speed",
    confused_with={"hydrodynamic_drag": "a series of speeds", "presliding_friction": "a series of speeds"},
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.VELOCITY),
        Instrument.SINGLE_AXIS: Observation(
            against=Variable.VELOCITY,
            shows=lambda p, unit: (
                f"below about {p.stribeck_velocity:.2g} {unit['stribeck_velocity']} there is up to "
                f"{abs(p.breakaway):.3g} "
                f"{unit['breakaway']} {'more' if p.breakaway > 0.0 else 'less'} friction than Coulomb's"
            ),
        ),
    },
    # friction at rest and in reversal is inferred from friction while moving; the law of its turn is not known
    model_error=0.1,
    near_rest=True,
    rises_by="breakaway_rise",
    friction=True,
    torque=lambda p, s: p.breakaway * hump(p, s) * s.sign,
)


def _bristle_rate(p: Values, s: Signals) -> Any:
    return s.v - p.stiffness * scalar.absolute(s.v) * s.state / scalar.maximum(s.coulomb, 1e-9)


PRESLIDING_FRICTION = Effect(
    name="presliding_friction",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "stiffness",
            "N m/rad",
            (300.0, 3e4),
            False,
            "stiffness s0 of the bristles",
            search=geometric(300.0, 3e4, 6),
            inverse=True,
            scale=Scale.YIELD,
            shares=geometric(1e-5, 1e-2, 10),
            noun="bristle stiffness",
        ),
        Parameter(
            "damping",
            "N m s/rad",
            (0.0, 50.0),
            False,
            "damping s1 of the bristles",
            search=(10.0,),
            fixed=True,
            noun="bristle damping",
        ),
    ),
    equation="tau = s0 z + s1 z' - F sign(q'),  z' = q' - s0 |q'| z / F   (Canudas de Wit et al., IEEE TAC 40(3), "
    "1995)",
    shows="a loop of torque over position after each reversal",
    confused_with={"backlash": "slow small torque ramps", "joint_compliance": "slow small torque ramps"},
    observed_by=AGAINST_VELOCITY,
    # as of Stribeck's
    model_error=0.1,
    near_rest=True,
    torque=lambda p, s: p.stiffness * s.state + p.damping * _bristle_rate(p, s) - s.coulomb * s.sign,
    rate=_bristle_rate,
)

EFFECTS = (VISCOUS_FRICTION, COULOMB_FRICTION, FRICTION_ASYMMETRY, STRIBECK_FRICTION, PRESLIDING_FRICTION)
