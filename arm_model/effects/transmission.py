"""Between motor and link: lost motion, elasticity, gear errors. Motor angle over gear minus link angle is the deflection."""

from __future__ import annotations

from typing import Any

from arm_model import scalar
from arm_model.effects.definition import Effect, Parameter, Place, Signals, Values


def _gap_spring(p: Values, s: Signals) -> Any:
    """Contact on either side of the gap: spring and damper that push, never pull."""
    above = scalar.maximum(s.twist - p.half_gap, 0.0)
    below = scalar.minimum(s.twist + p.half_gap, 0.0)
    return p.contact_stiffness * (above + below) + p.contact_damping * s.twist_rate * _touching(
        above - below, p.half_gap
    )


def _touching(depth: Any, half_gap: Any) -> Any:
    """0 inside the gap, rising to 1 over a hundredth of it."""
    return scalar.minimum(depth / (0.01 * half_gap + 1e-9), 1.0)


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
    confused_with={"joint_compliance": "a load bias closes the gap; compliance stays"},
    deflection=lambda p, s: p.half_gap * s.load / scalar.sqrt(s.load**2 + 1e-2),
    spring=_gap_spring,
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
        Parameter("phase", "rad", (-3.15, 3.15), False, "phase at motor angle 0", signed=True),
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
