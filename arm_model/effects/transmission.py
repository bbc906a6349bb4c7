"""Effects between motor and link: backlash, elasticity, gear errors.

The deflection is motor angle over gear minus link angle.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from arm_model.effects.definition import Effect, Parameter, Place, Signals, Values, geometric, integers
from arm_model.effects.observation import Excitation, Instrument, Observation, Span, Variable
from arm_model.rigid_body import scalar

WORST_RIPPLE = 0.02
"""rad (m): largest amplitude of a position error that repeats with the motor, ten times that of gears and encoders."""


def across_gap(half_gap: Any, twist: Any, rate: Any, spring: Callable[[Any, Any], Any]) -> Any:
    """Torque of a gap in series with ``spring`` (twist beyond the gap, its rate).

    Contact on either side can push but not pull.

    Bodies that part faster than the spring unloads are let go. The rate counts from a hundredth of the gap on.
    """
    above, below = scalar.maximum(twist - half_gap, 0.0), scalar.minimum(twist + half_gap, 0.0)
    seat = 0.01 * half_gap + 1e-9
    pushed = spring(above, rate * scalar.minimum(above / seat, 1.0))
    pulled = spring(below, rate * scalar.minimum(-below / seat, 1.0))
    return scalar.maximum(pushed, 0.0) + scalar.minimum(pulled, 0.0)


def _teeth(p: Values, s: Signals) -> Any:
    return across_gap(
        p.half_gap, s.twist, s.twist_rate, lambda twist, rate: p.contact_stiffness * twist + p.contact_damping * rate
    )


BACKLASH = Effect(
    name="backlash",
    place=Place.TRANSMISSION,
    parameters=(
        # how long the link flies depends on the gap alone: along a motion nothing shows how hard the teeth are
        Parameter(
            "half_gap",
            "rad",
            (2e-4, 5e-3),
            True,
            "half of the free play between motor and link",
            # from two steps of a good encoder on: along a motion, its steps hide narrower gaps
            search=geometric(2e-4, 7.5e-3, 11),
            # a gear with more backlash is not operated any more
            most=7.5e-3,
            tracker_prior=0.02,
        ),
        Parameter(
            "contact_stiffness",
            "N m/rad",
            (1e4, 1e6),
            False,
            "stiffness of the teeth in contact",
            search=(5e4, 1e5, 2e5, 4e5),
            derived=True,
        ),
        Parameter(
            "contact_damping",
            "N m s/rad",
            (0.0, 500.0),
            False,
            "damping of the teeth in contact",
            search=(80.0,),
            derived=True,
        ),
    ),
    equation="q_motor - q = +b where the load pushes, -b where it pulls",
    shows="lost motion at reversal and where the load changes sign: a jump, also at resting neighbours",
    confused_with={
        "joint_compliance": "a load bias closes the gap; compliance stays",
        "joint_zero_offset": "the joint slowly through the position where its load changes sign: backlash jumps "
        "there, an offset does not",
    },
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.LOAD),
        Instrument.LINK_ENCODER: Observation(
            shows="motor minus link encoder jumps between two values where the load or the motion reverses"
        ),
        Instrument.TRACKER: Observation(shows="the tracked point jumps about the axis where the load changes sign"),
        Instrument.CLOSED_LOOP: Observation(shows="a transmission with backlash"),
    },
    excited_by=Excitation.LOAD_REVERSAL,
    # a gap is inferred from the flight through it; the spring of the teeth is not known
    model_error=0.1,
    sparse=True,
    deflection=lambda p, s: p.half_gap * s.load / scalar.sqrt(s.load**2 + 1e-2),
    spring=_teeth,
)

JOINT_COMPLIANCE = Effect(
    name="joint_compliance",
    place=Place.TRANSMISSION,
    parameters=(
        Parameter(
            "stiffness",
            "N m/rad",
            (1e3, 2e5),
            False,
            "stiffness of the transmission",
            # a resonance is as narrow as its damping: in the band of comparison the grid has to be fine
            search=geometric(1e3, 1e6, 25),
            inverse=True,
            tracker_prior=1e-3,
            noun="joint stiffness",
        ),
        Parameter(
            "damping",
            "N m s/rad",
            (0.0, 500.0),
            False,
            "damping of the transmission",
            search=(5.0, 20.0, 80.0),
            # a spring of a small arm, damped by 20, does not ring; one of a heavy arm, damped by 80, does not stop
            damping_ratios=(0.0125, 0.05, 0.2),
            noun="joint damping",
        ),
    ),
    equation="q_motor - q = tau_load / k",
    shows="deflection follows the load; a resonance",
    confused_with={
        "time_skew": "link-side encoder or tracker, a chirp",
        "backlash": "a load bias closes the gap; compliance stays",
    },
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.LOAD),
        Instrument.LINK_ENCODER: Observation(
            against=Variable.LOAD, shows="motor minus link encoder is proportional to the load"
        ),
        Instrument.TRACKER: Observation(shows="the tracked point rotates about the axis in proportion to the torque"),
        Instrument.CLOSED_LOOP: Observation(shows="a resonance of an elastic transmission"),
    },
    excited_by=Excitation.LOAD,
    deflection=lambda p, s: s.load / p.stiffness,
    spring=lambda p, s: p.stiffness * s.twist + p.damping * s.twist_rate,
)

GEAR_RIPPLE = Effect(
    name="gear_ripple",
    place=Place.TRANSMISSION,
    parameters=(
        Parameter(
            "amplitude",
            "rad",
            (1e-5, 2e-3),
            True,
            "amplitude of the link's position error",
            most=WORST_RIPPLE,
            noun="ripple amplitude",
        ),
        Parameter(
            "torque",
            "N m",
            (0.05, 5.0),
            True,
            "amplitude of a torque at the joint, in the place of that error",
            noun="ripple torque",
        ),
        Parameter(
            "order",
            "1",
            (1, 60),
            False,
            "cycles per motor revolution; of a wave of another shaft: its cycles per turn times that shaft's turns per "
            "turn of the motor",
            whole=True,
            search=integers(1, 60),
        ),
        Parameter(
            "phase",
            "rad",
            (-3.15, 3.15),
            False,
            "phase at motor angle 0 (the motor's angle is abs(gear) q)",
            signed=True,
            span=Span.PHASE,
        ),
    ),
    equation="q_motor - q = -A sin(n q_motor + phi), or tau = T sin(n q_motor + phi)",
    shows="a fixed order of the angle of the motor or of a gear wheel, at any speed",
    confused_with={
        "cogging": "a run of the motor without its gear: the torque of uneven teeth vanishes, cogging remains",
        "mains_hum": "motion at two speeds: the frequency of hum does not change",
        "encoder_ripple": "tracker or link encoder",
    },
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.MOTOR_ANGLE),
        Instrument.LINK_ENCODER: Observation(
            shows=lambda p, unit: f"motor minus link encoder repeats {p.order:.4g} times per motor revolution",
            # of the motor's encoder
            aliases=("encoder_ripple",),
        ),
    },
    excited_by=Excitation.SPEED,
    deflection=lambda p, s: -p.amplitude * scalar.sin(p.order * s.motor + p.phase),
    torque=lambda p, s: p.torque * scalar.sin(p.order * s.motor + p.phase),
)

EFFECTS = (BACKLASH, JOINT_COMPLIANCE, GEAR_RIPPLE)
