"""Torques that depend on where the joint or its motor stands."""

from __future__ import annotations

from arm_model.effects.definition import Effect, Parameter, Place, integers
from arm_model.effects.observation import Excitation, Instrument, Observation, Span, Variable
from arm_model.rigid_body import scalar

GRAVITY_SPRING = Effect(
    name="gravity_spring",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "stiffness",
            "N m/rad",
            (1.0, 60.0),
            True,
            "stiffness of the balancing spring",
            signed=True,
            noun="spring stiffness",
        ),
        Parameter(
            "rest_angle",
            "rad",
            (-3.0, 3.0),
            False,
            "joint angle at which its torque is zero",
            signed=True,
            # slack a turn and more beyond every place that a joint can reach, it is a constant torque and no spring
            most=9.0,
            span=Span.SHIFT,
        ),
        Parameter(
            "hardening",
            "N m/rad3",
            (0.1, 20.0),
            True,
            "by how much the spring gets stiffer away from its rest angle",
            signed=True,
            term="hardening",
            # of a torque with the cube of the angle alone, a spring explains 84 to 91 %
            term_share=0.05,
        ),
        Parameter(
            "quintic",
            "N m/rad5",
            (0.02, 5.0),
            True,
            "by how much the hardening itself grows away from the rest angle",
            signed=True,
            term="quintic hardening",
            term_share=0.05,
            noun="quintic coefficient",
        ),
    ),
    equation="tau = k (q - q0) + h (q - q0)^3 + g (q - q0)^5",
    leading="tau = k (q - q0)",
    shows="error proportional to joint angle",
    confused_with={"current_offset": "the full range of the joint", "link_inertia": "the full range of the joint"},
    observed_by={Instrument.CURRENT: Observation(), Instrument.SINGLE_AXIS: Observation()},
    directional=True,
    torque=lambda p, s: (
        p.stiffness * (s.q - p.rest_angle)
        + p.hardening * (s.q - p.rest_angle) ** 3
        + p.quintic * (s.q - p.rest_angle) ** 5
    ),
    link_side=True,
)

COGGING = Effect(
    name="cogging",
    place=Place.MECHANICS,
    parameters=(
        Parameter("amplitude", "N m", (0.05, 5.0), True, "amplitude at the joint", noun="cogging amplitude"),
        Parameter("pole_pairs", "1", (1, 60), False, "cycles per motor revolution", whole=True, search=integers(1, 60)),
        Parameter(
            "phase",
            "rad",
            (-3.15, 3.15),
            False,
            "phase at motor angle 0 (the motor's angle is abs(gear) q)",
            signed=True,
            span=Span.PHASE,
        ),
        Parameter(
            "per_load",
            "1",
            (0.005, 0.1),
            True,
            "growth of the amplitude with the transmitted torque",
            signed=True,
            term="growth with load",
            term_share=0.5,
        ),
    ),
    equation="tau = (A + c |tau_load|) sin(Np q_motor + phi)",
    leading="tau = A sin(Np q_motor + phi)",
    shows="a fixed order of the motor angle, also without load",
    confused_with={
        "gear_ripple": "a run of the motor without its gear: the torque of uneven teeth vanishes, cogging remains"
    },
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.MOTOR_ANGLE),
        Instrument.SINGLE_AXIS: Observation(),
    },
    excited_by=Excitation.SPEED,
    # a torque that goes with the motor's angle is made by uneven teeth as well as by magnets
    aliases=("gear_ripple",),
    torque=lambda p, s: (
        (p.amplitude + p.per_load * scalar.absolute(s.load)) * scalar.sin(p.pole_pairs * s.motor + p.phase)
    ),
)

EFFECTS = (GRAVITY_SPRING, COGGING)
