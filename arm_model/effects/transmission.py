"""Between motor and link: lost motion, elasticity, gear errors. Motor angle over gear minus link angle is the deflection."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from arm_model.effects.definition import Effect, Parameter, Place, Signals, Values
from arm_model.rigid_body import scalar


def across_gap(half_gap: Any, twist: Any, rate: Any, spring: Callable[[Any, Any], Any]) -> Any:
    """Torque of a gap in series with ``spring`` (twist beyond the gap, its rate): contact on either side that pushes, never pulls.

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
        Parameter("half_gap", "rad", (1e-4, 5e-3), True, "half of the free play between motor and link"),
        Parameter("contact_stiffness", "N m/rad", (1e4, 1e6), False, "stiffness of the teeth in contact"),
        Parameter("contact_damping", "N m s/rad", (0.0, 500.0), False, "damping of the teeth in contact"),
    ),
    equation="q_motor - q = +b where the load pushes, -b where it pulls",
    shows="lost motion at reversal and where the load changes sign: a current jump, felt by resting neighbours",
    confused_with={
        "joint_compliance": "a load bias closes the gap; compliance stays",
        "joint_zero_offset": "the joint slowly through the place where its load changes sign: play jumps there, a zero stays",
    },
    deflection=lambda p, s: p.half_gap * s.load / scalar.sqrt(s.load**2 + 1e-2),
    spring=_teeth,
)

JOINT_COMPLIANCE = Effect(
    name="joint_compliance",
    place=Place.TRANSMISSION,
    parameters=(
        Parameter("stiffness", "N m/rad", (1e3, 2e5), False, "stiffness of the transmission"),
        Parameter("damping", "N m s/rad", (0.0, 500.0), False, "damping of the transmission"),
    ),
    equation="q_motor - q = tau_load / k",
    shows="deflection follows the load; a resonance",
    confused_with={
        "time_skew": "link-side encoder or tracker, a chirp",
        "backlash": "a load bias closes the gap; compliance stays",
    },
    deflection=lambda p, s: s.load / p.stiffness,
    spring=lambda p, s: p.stiffness * s.twist + p.damping * s.twist_rate,
)

GEAR_RIPPLE = Effect(
    name="gear_ripple",
    place=Place.TRANSMISSION,
    parameters=(
        Parameter("amplitude", "rad", (1e-5, 2e-3), True, "amplitude of the link's position error"),
        Parameter("order", "1", (1, 60), False, "cycles a motor revolution", whole=True),
        Parameter(
            "phase",
            "rad",
            (-3.15, 3.15),
            False,
            "phase at motor angle 0 (the motor's angle is abs(gear) q)",
            signed=True,
        ),
    ),
    equation="q_motor - q = -A sin(n q_motor + phi)",
    shows="a fixed order of the motor angle at any speed, growing with the square of speed",
    confused_with={
        "cogging": "two speeds",
        "mains_hum": "two speeds: hum is fixed in time",
        "encoder_ripple": "tracker or link encoder",
    },
    deflection=lambda p, s: -p.amplitude * scalar.sin(p.order * s.motor + p.phase),
)

EFFECTS = (BACKLASH, JOINT_COMPLIANCE, GEAR_RIPPLE)
