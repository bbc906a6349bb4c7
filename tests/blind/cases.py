"""Cases drawn from a seed that the finder never sees: effect, joint, magnitude, phase; pairs; nothing; and what no catalogue has."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from tests.blind.hide import Hidden

Draw = Callable[[np.random.Generator, int, float], dict[str, float]]

COULOMB = (24.7, 13.6, 7.1)
"""N m at joints 1-3: what friction magnitudes are a share of."""
VISCOUS = (5.8, 9.5, 4.0)
ROTOR = (0.78, 2.32, 0.58)


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-3.0, 3.0))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


SINGLES: dict[str, Draw] = {
    "viscous_friction": lambda rng, j, m: {"viscous": _sign(rng) * 0.3 * m * VISCOUS[j]},
    "coulomb_friction": lambda rng, j, m: {"coulomb": _sign(rng) * 0.15 * m * COULOMB[j]},
    "friction_asymmetry": lambda rng, j, m: {"positive": 0.15 * m * COULOMB[j], "negative": -0.1 * m * COULOMB[j]},
    "stribeck_friction": lambda rng, j, m: {
        "breakaway": 0.5 * m * COULOMB[j],
        "stribeck_velocity": float(rng.uniform(0.06, 0.12)),
    },
    "presliding_friction": lambda rng, j, m: {"stiffness": 200.0 / m * COULOMB[j], "damping": 10.0},
    "load_friction": lambda rng, j, m: {"mu": 0.07 * m},
    "friction_drift": lambda rng, j, m: {"fraction": 0.2 * m, "time_constant": float(rng.uniform(4.0, 10.0))},
    "gear_ripple": lambda rng, j, m: {"amplitude": 2e-4 * m, "order": float(rng.integers(2, 9)), "phase": _phase(rng)},
    "cogging": lambda rng, j, m: {
        "amplitude": 0.03 * m * COULOMB[j],
        "pole_pairs": float(rng.integers(2, 9)),
        "phase": _phase(rng),
    },
    "backlash": lambda rng, j, m: {"half_gap": 2e-3 * m},
    "joint_compliance": lambda rng, j, m: {"stiffness": 6e3 / m},
    "payload": lambda rng, j, m: {"mass": 0.5 * m, "x": 0.0, "y": 0.0, "z": float(rng.uniform(0.03, 0.1))},
    "link_inertia": lambda rng, j, m: {"scale": 1.0 + 0.1 * m},
    "rotor_inertia": lambda rng, j, m: {"inertia": 0.3 * m * ROTOR[j]},
    "base_tilt": lambda rng, j, m: {"roll": float(rng.normal(0, 0.01 * m)), "pitch": 0.01 * m * _sign(rng)},
    "gravity_spring": lambda rng, j, m: {"stiffness": 5.0 * m, "rest_angle": float(rng.uniform(-1.0, 0.5))},
    "torque_constant": lambda rng, j, m: {"error": _sign(rng) * 0.08 * m},
    "wrist_coupling": lambda rng, j, m: {"c54": 0.0, "c64": 0.03 * m, "c65": 0.05 * m},
    "encoder_ripple": lambda rng, j, m: {
        "amplitude": 3e-4 * m,
        "order": float(rng.integers(1, 3)),
        "phase": _phase(rng),
    },
    "missed_counts": lambda rng, j, m: {"jump": _sign(rng) * 4e-3 * m, "time": float(rng.uniform(4.0, 9.0))},
    "joint_zero_offset": lambda rng, j, m: {"offset": _sign(rng) * 0.02 * m},
    "current_offset": lambda rng, j, m: {"offset": _sign(rng) * 0.05 * m},
    "current_gain": lambda rng, j, m: {"error": _sign(rng) * 0.08 * m},
    "current_nonlinearity": lambda rng, j, m: {"cubic": 0.01 * m},
    "mains_hum": lambda rng, j, m: {
        "amplitude": 0.03 * m,
        "frequency": float(rng.choice([50.0, 60.0])),
        "phase": _phase(rng),
    },
    "time_skew": lambda rng, j, m: {"delay": 0.002 * m},
}
"""Parameters at joint j (from 0) and magnitude m, 1 being realistic."""

WHOLE_ARM = {"payload", "base_tilt", "wrist_coupling", "time_skew"}
GRAVITY_LOADED = {
    "load_friction",
    "backlash",
    "gravity_spring",
    "joint_zero_offset",
    "current_nonlinearity",
    "link_inertia",
}
"""Effects that need gravity at the joint to be there at all: hidden at joints 2 and 3 only."""

SAME = ({"torque_constant", "current_gain"}, {"payload", "link_inertia"})
"""Effects that currents and motor angles cannot tell apart: either name is right if the other is in its group."""


@dataclass(frozen=True)
class Case:
    """A name for the table, and what is hidden; ``unknown``: no effect of the catalogue is."""

    kind: str
    hidden: tuple[Hidden, ...]
    seed: int
    unknown: bool = False


def single(effect: str, magnitude: float, seed: int) -> Hidden:
    """One effect at a joint drawn from 1-3."""
    rng = np.random.default_rng([seed, *map(ord, effect)])
    joint = int(rng.integers(1, 3) if effect in GRAVITY_LOADED else rng.integers(0, 3))
    return Hidden(effect, None if effect in WHOLE_ARM else joint + 1, SINGLES[effect](rng, joint, magnitude))


def cases(seed: int, magnitudes: tuple[float, ...] = (1.0,), pairs: int = 10, empty: int = 5) -> Iterator[Case]:
    """All singles at the magnitudes given, random pairs of different joints or effects, nothing, and two strangers."""
    for magnitude in magnitudes:
        for effect in SINGLES:
            yield Case(f"single x{magnitude:g}", (single(effect, magnitude, seed),), seed)
    rng = np.random.default_rng(seed)
    names = list(SINGLES)
    for number in range(pairs):
        one, other = rng.choice(len(names), 2, replace=False)
        yield Case(
            "pair",
            (single(names[one], 1.0, seed + number), single(names[other], 1.0, seed + 50 + number)),
            seed + number,
        )
    for number in range(empty):
        yield Case("nothing", (), seed + number)
    for effect, parameters in (
        ("position_torque", {"amplitude": 3.0, "cycles": 3.0}),
        ("offset_drift", {"slope": 0.01}),
    ):
        yield Case("stranger", (Hidden(effect, int(rng.integers(1, 4)), parameters),), seed, unknown=True)
