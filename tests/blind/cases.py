"""Cases drawn from a seed that the finder never sees: effect, joint, magnitude, phase, laboratory.

A case hides one effect, a pair, a triple, nothing, or a defect outside the catalogue.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from tests.blind import unmodelled
from tests.blind.hide import Hidden
from tests.blind.laboratory import Laboratory, laboratory
from tests.blind.magnitude import Wanted

Draw = Callable[[np.random.Generator, int, float], dict[str, float]]

COULOMB = (26.0, 10.6, 6.4)
"""N m at joints 1-3, mean of both directions: what friction magnitudes are a share of."""
VISCOUS = (5.8, 9.5, 4.0)
ROTOR = (0.78, 2.32, 0.58)
RATED = (97.6, 186.4, 89.4)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _signed(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.choice([-1.0, 1.0])) * _between(rng, low, high)


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-3.0, 3.0))


def _asymmetry(rng: np.random.Generator, j: int, m: float) -> dict[str, float]:
    part = _signed(rng, 0.05, 0.15) * m * COULOMB[j]
    values = {"positive": part, "negative": -part * float(rng.uniform(0.5, 1.0))}
    if rng.uniform() < 0.5:  # as measured drives have it: slopes differ as well
        slope = _signed(rng, 0.1, 0.3) * m * VISCOUS[j]
        values |= {"viscous_positive": slope, "viscous_negative": -slope * float(rng.uniform(0.3, 1.0))}
    return values


def _link(rng: np.random.Generator, j: int, m: float) -> dict[str, float]:
    """A piece of 0.3 to 1 kg that is on the link and not in the model.

    Mass, moment and inertia about the link's frame.
    """
    mass, place = (
        _between(rng, 0.3, 1.0) * m,
        rng.uniform([-0.4, -0.1, -0.1], [0.0, 0.1, 0.1]) * (1.0 if j == 1 else 0.6),
    )
    x, y, z = place
    about = {
        "ixx": y * y + z * z,
        "iyy": x * x + z * z,
        "izz": x * x + y * y,
        "ixy": -x * y,
        "iyz": -y * z,
        "ixz": -x * z,
    }
    values = {"mass": 1.0, "mx": x, "my": y, "mz": z} | about
    return {name: float(mass * value) for name, value in values.items()}


SINGLES: dict[str, Draw] = {
    "viscous_friction": lambda rng, j, m: {"viscous": _signed(rng, 0.2, 0.5) * m * VISCOUS[j]},
    "coulomb_friction": lambda rng, j, m: {"coulomb": _signed(rng, 0.15, 0.5) * m * COULOMB[j]},
    "friction_asymmetry": _asymmetry,
    "stribeck_friction": lambda rng, j, m: {
        "breakaway": _between(rng, 0.2, 0.6) * m * COULOMB[j],
        "stribeck_velocity": _between(rng, 0.03, 0.12),
    },
    "presliding_friction": lambda rng, j, m: {
        "stiffness": _between(rng, 80.0, 300.0) / m * COULOMB[j],
        "damping": 10.0,
    },
    "load_friction": lambda rng, j, m: {"mu": _between(rng, 0.03, 0.15) * m},
    "friction_drift": lambda rng, j, m: {
        "fraction": _between(rng, 0.1, 0.4) * m,
        "time_constant": _between(rng, 4.0, 12.0),
    },
    "gear_ripple": lambda rng, j, m: {
        "amplitude": _between(rng, 1e-4, 4e-4) * m,
        "order": float(rng.integers(1, 7)),
        "phase": _phase(rng),
    },
    "cogging": lambda rng, j, m: {
        "amplitude": _between(rng, 0.01, 0.03) * m * RATED[j],
        "pole_pairs": float(rng.integers(2, 9)),
        "phase": _phase(rng),
    },
    "backlash": lambda rng, j, m: {"half_gap": _between(rng, 5e-4, 3e-3) * m},
    "joint_compliance": lambda rng, j, m: {"stiffness": _between(rng, 4e3, 2e4) / m},
    "payload": lambda rng, j, m: {
        "mass": _between(rng, 0.3, 1.5) * m,
        "x": float(rng.uniform(-0.05, 0.05)),
        "y": float(rng.uniform(-0.05, 0.05)),
        "z": float(rng.uniform(0.03, 0.15)),
    },
    "link_inertia": _link,
    "rotor_inertia": lambda rng, j, m: {"inertia": _between(rng, 0.2, 0.5) * m * ROTOR[j]},
    "base_tilt": lambda rng, j, m: {"roll": _signed(rng, 0.005, 0.03) * m, "pitch": _signed(rng, 0.005, 0.03) * m},
    "gravity_spring": lambda rng, j, m: {
        "stiffness": _between(rng, 2.0, 15.0) * m,
        "rest_angle": float(rng.uniform(-1.0, 0.5)),
    },
    "torque_constant": lambda rng, j, m: {"error": _signed(rng, 0.05, 0.15) * m},
    "current_limit": lambda rng, j, m: {"share": float(rng.uniform(0.6, 0.9))},
    "wrist_coupling": lambda rng, j, m: {
        "c54": _signed(rng, 0.02, 0.1) * m,
        "c64": _signed(rng, 0.02, 0.1) * m,
        "c65": _signed(rng, 0.02, 0.2) * m,
    },
    "encoder_ripple": lambda rng, j, m: {
        "amplitude": _between(rng, 1e-4, 5e-4) * m,
        "order": float(rng.integers(1, 3)),
        "phase": _phase(rng),
    },
    "missed_counts": lambda rng, j, m: {
        "counts": float(np.round(_signed(rng, 10.0, 100.0) * m)),
        "time": float(rng.uniform(3.0, 9.0)),
    },
    "joint_zero_offset": lambda rng, j, m: {"offset": _signed(rng, 0.008, 0.04) * m},
    "current_offset": lambda rng, j, m: {"offset": _signed(rng, 0.02, 0.15) * m},
    "current_gain": lambda rng, j, m: {"error": _signed(rng, 0.05, 0.15) * m},
    "current_nonlinearity": lambda rng, j, m: {"cubic": _between(rng, 0.003, 0.02) * m},
    "mains_hum": lambda rng, j, m: {
        "amplitude": _between(rng, 0.015, 0.06) * m,
        "frequency": float(rng.choice([50.0, 60.0]) + rng.uniform(-0.05, 0.05)),
        "phase": _phase(rng),
    },
    "time_skew": lambda rng, j, m: {"delay": _between(rng, 5e-4, 4e-3) * m},
    "dropped_trigger": lambda rng, j, m: {
        "row": float(rng.integers(3000, 5000)),
        "count": float(max(1, np.round(_between(rng, 1.5, 8.0) * m))),
    },
    "hydrodynamic_drag": lambda rng, j, m: {"drag": _between(rng, 1.0, 5.0) * m},
}
"""Parameters at joint j (from 0) and magnitude m: the typical range of the vocabulary at 1."""

WHOLE_ARM = {"payload", "base_tilt", "wrist_coupling", "time_skew", "dropped_trigger"}
GRAVITY_LOADED = {"load_friction", "backlash", "joint_zero_offset", "current_nonlinearity", "link_inertia"}
"""Effects that need gravity at the joint to be there at all: hidden at joints 2 and 3 only."""
NOT_WEAK = {"current_limit", "dropped_trigger", "wrist_coupling", "presliding_friction"}
"""Effects that are there or not: no small one is drawn.

Of a wrist's coupling currents show next to nothing; its motors turn. Bristles that get stiffer come near to dry
friction, not to nothing.
"""

SAME = (
    {"torque_constant", "current_gain"},
    {"payload", "link_inertia"},
    {"gear_ripple", "encoder_ripple"},
    {"gear_ripple", "cogging"},
    {"friction_asymmetry", "current_offset"},
    {"joint_zero_offset", "link_geometry"},
    {"link_sag", "joint_compliance"},
)
"""Effects that the vocabulary says currents and motor angles of moves cannot tell apart (a shunt, a known mass, a
tracker, drives off would), nor a tracker the last two: either name is right if the other is in its group."""

KINDS = ("singles", "weak", "large", "pairs", "triples", "empties", "unmodelled")
COUNTS = {"pairs": 20, "triples": 10, "empties": 20}


@dataclass(frozen=True)
class Case:
    """Where it was recorded and what is hidden there, before ``magnitude`` has scaled it.

    key: its name in a cache, and its seed.
    """

    kind: str
    number: int
    key: tuple[int, ...]
    laboratory: Laboratory
    effects: tuple[tuple[str, int | None], ...]
    wanted: Wanted
    scale: float = 1.0

    @property
    def name(self) -> str:
        """As ``--only`` finds it."""
        hidden = "+".join(f"{effect}@{joint or '-'}" for effect, joint in self.effects) or "nothing"
        return f"{self.kind}-{self.number}-{hidden}"

    def hidden(self, strengths: tuple[float, ...]) -> tuple[Hidden, ...]:
        """The effects at strengths relative to what was drawn."""
        drawn = []
        for number, ((effect, joint), strength) in enumerate(zip(self.effects, strengths)):
            rng = np.random.default_rng([*self.key, number, *map(ord, effect)])
            if effect in unmodelled.DRAWN:
                values = unmodelled.DRAWN[effect](rng, joint or 1, strength)
            else:
                values = SINGLES[effect](rng, (joint or 1) - 1, strength * self.scale)
            drawn.append(Hidden(effect, joint, values))
        return tuple(drawn)


def _placed(rng: np.random.Generator, effect: str, joint: int | None = None) -> tuple[str, int | None]:
    if effect in WHOLE_ARM:
        return effect, None
    return effect, joint or int(rng.integers(2, 4) if effect in GRAVITY_LOADED else rng.integers(1, 4))


def _several(rng: np.random.Generator, how_many: int) -> tuple[tuple[str, int | None], ...]:
    """Different kinds, in half of the cases at the same joint; never two that no data can tell apart."""
    while True:
        names = [str(name) for name in rng.choice(list(SINGLES), how_many, replace=False)]
        if any(len(same & set(names)) > 1 for same in SAME):
            continue
        joint = int(rng.integers(2, 4)) if rng.uniform() < 0.5 else None
        return tuple(_placed(rng, name, joint) for name in names)


def cases(kind: str, seed: int, number: int | None = None) -> Iterator[Case]:
    """Cases of one kind: ``number`` of them, or one per effect (``singles``, ``weak``, ``large``, ``unmodelled``)."""
    place = KINDS.index(kind)
    names: list[str | None] = [None] * (number or COUNTS.get(kind, 0))
    if kind in ("singles", "weak", "large"):
        names = [name for name in SINGLES if kind == "singles" or name not in NOT_WEAK]
    elif kind == "unmodelled":
        names = list(unmodelled.DRAWN)
    for index, name in enumerate(names[:number]):
        key = (seed, place, index)
        rng = np.random.default_rng(key)
        where = laboratory(int(rng.integers(1 << 30)))
        case = Case(kind, index, key, where, (), Wanted(3.0, None))
        if kind == "weak":
            target = float(rng.uniform(2.0, 3.0))
            case = replace(case, wanted=Wanted(target, target))
        elif kind == "large":
            case = replace(case, scale=2.5)
        elif kind == "unmodelled":
            target = float(rng.uniform(6.0, 15.0))
            case = replace(case, wanted=Wanted(target, target))
        if name is not None:
            yield replace(case, effects=(_placed(rng, name),))
        elif kind == "empties":
            yield case
        else:
            yield replace(case, effects=_several(rng, 2 if kind == "pairs" else 3))
