"""Motors that turn more than their own axis."""

from __future__ import annotations

from arm_model.effects.definition import Effect, Parameter, Place
from arm_model.effects.observation import Excitation, Instrument, Observation

WRIST_COUPLING = Effect(
    name="wrist_coupling",
    place=Place.TRANSMISSION,
    parameters=(
        Parameter(
            "c54",
            "1",
            (0.005, 0.3),
            True,
            "turn of axis 5 for a turn of motor 4 (both over gear)",
            signed=True,
            noun="turn of axis 5 of {} per turn of motor 4",
        ),
        Parameter(
            "c64",
            "1",
            (0.005, 0.3),
            True,
            "turn of axis 6 for a turn of motor 4",
            signed=True,
            noun="turn of axis 6 of {} per turn of motor 4",
        ),
        Parameter(
            "c65",
            "1",
            (0.005, 0.3),
            True,
            "turn of axis 6 for a turn of motor 5",
            signed=True,
            noun="turn of axis 6 of {} per turn of motor 5",
        ),
    ),
    equation="q5 = m5 + c54 m4,  q6 = m6 + c64 m4 + c65 m5;  the torques go back by the transpose",
    shows="a resting joint's motor turns, or is loaded, as another axis moves",
    confused_with={"link_inertia": "slow single moves"},
    per_joint=False,
    observed_by={
        Instrument.CURRENT: Observation(),
        Instrument.DEMAND: Observation(),
        Instrument.LINK_ENCODER: Observation(shows="motors turn links of other axes than their own"),
    },
    excited_by=Excitation.SPEED,
    coupling=True,
)

EFFECTS = (WRIST_COUPLING,)
