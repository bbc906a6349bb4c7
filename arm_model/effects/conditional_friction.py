"""Friction that depends on load, temperature, time or rest, beside that over speed and position (``friction``).

The longer two surfaces rest on each other, the more force it takes to part them: the level grows with the logarithm of
that time (Dieterich, J. Geophys. Res. 77(20), 1972). Contacts are renewed over a short distance of sliding, so that
their age is the state of Ruina's ageing law (J. Geophys. Res. 88(B12), 1983).
"""

from __future__ import annotations

from math import log

from arm_model.effects.definition import Effect, Parameter, Place, geometric
from arm_model.effects.friction import AGAINST_VELOCITY, changed, hump, with_time
from arm_model.effects.observation import Excitation, Instrument, Observation, Scale, Variable
from arm_model.rigid_body import scalar

YOUNGEST = 0.05
"""s: contacts that are younger are alike. The logarithm has no value at 0."""
_SOURCE = "Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134(5), 051013, 2012"

LOAD_FRICTION = Effect(
    name="load_friction",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "mu",
            "1",
            (0.02, 0.2),
            True,
            "friction as a share of the transmitted torque, at the start of a recording",
            noun="load friction coefficient",
        ),
        *with_time("1/s", (1e-4, 0.01)),
    ),
    equation="tau = (mu + m min(t, te)) |tau_load| sign(q')",
    leading="tau = mu |tau_load| sign(q')",
    shows="a step at reversal that grows with the gravity load",
    confused_with={
        "torque_constant": "poses with and without payload",
        "current_nonlinearity": "poses with and without payload",
    },
    observed_by={Instrument.CURRENT: Observation(against=Variable.LOAD)},
    excited_by=Excitation.LOAD,
    conditional=True,
    torque=lambda p, s: (p.mu + changed(p, s)) * scalar.absolute(s.load) * s.sign,
)

LOAD_BREAKAWAY = Effect(
    name="load_breakaway",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "share",
            "1",
            (0.02, 0.2),
            True,
            "friction at low speed beyond load friction, as a share of the transmitted torque",
            signed=True,
            noun="load-dependent break-away friction",
        ),
        Parameter(
            "stribeck_velocity",
            "rad/s",
            (0.01, 0.2),
            False,
            "velocity at which it has fallen to 1/e",
            search=geometric(0.01, 0.2, 6),
            scale=Scale.SPEED,
            shares=geometric(0.01, 0.3, 6),
        ),
    ),
    equation=f"tau = s |tau_load| exp(-(q'/vs)^2) sign(q')   (as {_SOURCE}, with the exponent 2)",
    shows="a hump at low speed that grows with the load",
    confused_with={"load_friction": "slow and fast motion under the same load"},
    observed_by={Instrument.IDENTIFICATION: Observation(against=Variable.LOAD)},
    excited_by=Excitation.LOAD,
    conditional=True,
    torque=lambda p, s: p.share * scalar.absolute(s.load) * hump(p, s) * s.sign,
)

TEMPERATURE_FRICTION = Effect(
    name="temperature_friction",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "coulomb", "N m/K", (0.01, 0.2), True, "change of Coulomb friction", signed=True, noun="Coulomb friction"
        ),
        Parameter(
            "viscous",
            "N m s/(rad K)",
            (0.02, 0.5),
            True,
            "change of the viscous coefficient at the joint's reference temperature",
            signed=True,
            noun="viscous friction",
        ),
        Parameter(
            "breakaway",
            "N m/K",
            (0.01, 0.2),
            True,
            "change of the friction above Coulomb's at low speed",
            signed=True,
            noun="break-away friction",
        ),
        Parameter(
            "stribeck_velocity",
            "rad/s",
            (0.01, 0.1),
            False,
            "velocity at which the last has fallen to 1/e",
            # a wider hump looks like friction at all speeds
            search=geometric(0.01, 0.1, 4),
            coarse=True,
            scale=Scale.SPEED,
            shares=geometric(0.02, 0.5, 5),
        ),
        Parameter(
            "thinning",
            "K",
            (15.0, 60.0),
            False,
            "rise of temperature after which the viscous part changes by 1/e of what it did (grease becomes thin)",
            search=(15.0, 25.0, 60.0),
            coarse=True,
        ),
    ),
    equation="tau = W (F + S exp(-(q'/vs)^2)) sign(q') + B T (1 - exp(-W/T)) q',  W = temperature - reference   "
    f"({_SOURCE}, whose vs depends on temperature, too)",
    shows="friction that changes as the motor warms up",
    confused_with={"friction_drift": "a cold start after a warm one", "torque_constant": "friction without load"},
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.VELOCITY),
        Instrument.IDENTIFICATION: Observation(against=Variable.VELOCITY),
    },
    excited_by=Excitation.TEMPERATURE,
    conditional=True,
    torque=lambda p, s: (
        s.warmer * (p.coulomb + p.breakaway * hump(p, s)) * s.sign
        + p.viscous * p.thinning * (1 - scalar.exp(-s.warmer / p.thinning)) * s.v
    ),
)

FRICTION_DRIFT = Effect(
    name="friction_drift",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "fraction",
            "1",
            (0.05, 0.5),
            True,
            "share of the Coulomb friction that disappears as the arm warms up",
            most=1.0,
            noun="loss of {} of the Coulomb friction",
        ),
        Parameter(
            "time_constant",
            "s",
            (3.0, 600.0),
            False,
            "time constant of the warm-up",
            search=geometric(3.0, 600.0, 6),
        ),
        Parameter(
            "difference",
            "1",
            (0.01, 0.3),
            True,
            "by how much a larger share disappears while moving positive, and a smaller one while moving negative",
            signed=True,
            term="difference between directions",
            term_share=0.3,
        ),
    ),
    equation="tau = -(a + d sign(q')) F (1 - exp(-t/T)) sign(q')",
    leading="tau = -a F (1 - exp(-t/T)) sign(q')",
    shows="the same move needs less torque each time",
    confused_with={
        "torque_constant": "one cycle repeated, with holds",
        "coulomb_friction": "a start from cold, and one cycle repeated",
    },
    observed_by=AGAINST_VELOCITY,
    near_cases=("coulomb_friction",),
    torque=lambda p, s: (
        -(p.fraction + p.difference * s.sign) * s.coulomb * (1 - scalar.exp(-s.t / p.time_constant)) * s.sign
    ),
)

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

EFFECTS = (LOAD_FRICTION, LOAD_BREAKAWAY, TEMPERATURE_FRICTION, FRICTION_DRIFT, BREAKAWAY_RISE)
