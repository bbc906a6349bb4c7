"""Break-away friction that rises with the time at rest.

The longer two surfaces rest on each other, the more force it takes to part them: the level grows with the logarithm of
that time (Dieterich, J. Geophys. Res. 77(20), 1972). Contacts are renewed over a short distance of sliding, so that
their age is the state of Ruina's ageing law (J. Geophys. Res. 88(B12), 1983).
"""

from __future__ import annotations

from math import log

from arm_model.effects.definition import Effect, Parameter, Place
from arm_model.effects.friction import hump
from arm_model.effects.observation import Instrument, Observation, Variable
from arm_model.rigid_body import scalar

YOUNGEST = 0.05
"""s: contacts that are younger are alike. The logarithm has no value at 0."""

BREAKAWAY_RISE = Effect(
    name="breakaway_rise",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "rise",
            "N m",
            (0.05, 5.0),
            True,
            "rise of the break-away friction for ten times the time at rest",
            noun="rise of the break-away friction with the time at rest",
        ),
        Parameter(
            "stribeck_velocity", "rad/s", (0.01, 0.2), False, "velocity at which friction at rest has fallen to 1/e"
        ),
        Parameter("reference", "s", (0.1, 10.0), False, "time at rest after which it adds nothing; less before"),
        Parameter("slip", "rad", (1e-4, 0.1), False, "distance of sliding that renews the contacts to 1/e"),
    ),
    equation=f"tau = R log10(max(a, {YOUNGEST} s)/t0) exp(-(q'/vs)^2) sign(q'),  a' = 1 - |q'| a / D   (Dieterich, J. "
    "Geophys. Res. 77(20), 1972; Ruina, J. Geophys. Res. 88(B12), 1983)",
    shows="a hump at low speed that is higher after a longer rest",
    confused_with={"stribeck_friction": "slow starts after rests of 0.2, 1 and 5 s"},
    observed_by={Instrument.IDENTIFICATION: Observation(against=Variable.VELOCITY)},
    torque=lambda p, s: (
        p.rise / log(10.0) * scalar.log(scalar.maximum(s.state, YOUNGEST) / p.reference) * hump(p, s) * s.sign
    ),
    rate=lambda p, s: 1.0 - scalar.absolute(s.v) * s.state / p.slip,
)

EFFECTS = (BREAKAWAY_RISE,)
