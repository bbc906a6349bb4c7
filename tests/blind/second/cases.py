"""Cases drawn from a seed: which effects, where, how strong. Every effect is dealt once before any comes again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tests.blind.second.effects import GROWS, KINDS, NEEDS_TRACKER
from tests.blind.second.laboratory import Laboratory, laboratory
from tests.blind.second.strangers import STRANGERS

COUNTS = {"singles": 10, "weak": 3, "pairs": 4, "triples": 2, "empties": 2, "unmodelled": 3}
"""Cases of a kind where no number is asked for: 27 effects are hidden in them."""
SIZES = {"weak": (2.0, 3.0), "unmodelled": (5.0, 10.0)}
"""Times the noise; others 3 to 10."""
TOGETHER = (
    {"torque_constant", "current_gain"},
    {"payload", "link_inertia"},
    {"gear_ripple", "encoder_ripple", "cogging"},
    {"friction_asymmetry", "current_offset"},
    {"joint_zero_offset", "link_geometry", "base_tilt"},
    {"coulomb_friction", "presliding_friction", "stribeck_friction"},
    {"current_limit", "torque_constant"},
)
"""Of which no case hides two: the vocabulary says that motions hardly tell them apart, or one hides the other."""
GROWTH = 0.4


@dataclass(frozen=True)
class Case:
    """effects: (name, joint or None); size: over the noise that each is to have; growth: of effects that change."""

    kind: str
    number: int
    key: tuple[int, int, int]
    where: Laboratory
    effects: tuple[tuple[str, int | None], ...]
    sizes: tuple[float, ...]
    growth: float = 0.0

    @property
    def name(self) -> str:
        """kind-number-effect@joint."""
        hidden = "+".join(f"{effect}@{joint or '-'}" for effect, joint in self.effects) or "nothing"
        return f"{self.kind}-{self.number}-{hidden}"


def cases(kind: str, seed: int, number: int | None = None) -> Iterator[Case]:
    """The first ``number`` cases of a kind; None: as many as ``COUNTS`` says."""
    for index, names in enumerate(_dealt(seed)[kind] if number is None else _dealt(seed, number)[kind]):
        yield drawn(kind, seed, index, names)


def drawn(kind: str, seed: int, index: int, names: tuple[str, ...], attempt: int = 0) -> Case:
    """One case; another attempt puts the same effects elsewhere."""
    rng = np.random.default_rng([seed, list(COUNTS).index(kind), index, attempt])
    # attempts are counted in the key, so that a laboratory in which an effect cannot show is left
    key = (seed, list(COUNTS).index(kind) + 10 * attempt, index)
    tracker = bool(NEEDS_TRACKER & set(names)) or "ringing_tripod" in names
    where = laboratory(int(rng.integers(1 << 30)), tracker=tracker, water="added_mass" in names)
    low, high = SIZES.get(kind, (3.0, 10.0))
    placed = tuple((name, _joint(rng, name)) for name in names)
    sizes = tuple(float(np.exp(rng.uniform(np.log(low), np.log(high)))) for _ in names)
    grows = kind == "singles" and names[0] in GROWS and rng.uniform() < 0.4
    return Case(kind, index, key, where, placed, sizes, GROWTH if grows else 0.0)


def _joint(rng: np.random.Generator, name: str) -> int | None:
    joints = {**KINDS, **STRANGERS}[name].joints
    return int(rng.choice(joints)) if joints else None


def _dealt(seed: int, number: int | None = None) -> dict[str, list[tuple[str, ...]]]:
    """Names by kind and case, from a pack that is shuffled again when it is empty."""
    rng = np.random.default_rng([seed, 996])
    pack: list[str] = []

    def deal(taken: tuple[str, ...], allowed: set[str]) -> str:
        for _ in range(2):
            for name in pack:
                if name in allowed and name not in taken and not any(len(s & {*taken, name}) > 1 for s in TOGETHER):
                    pack.remove(name)
                    return name
            pack.extend(str(name) for name in rng.permutation(list(KINDS)))
        raise AssertionError("a whole pack has a name that goes with the others")

    hands = {kind: number or count for kind, count in COUNTS.items()}
    measured = {name for name, kind in KINDS.items() if kind.shown_by != "events"}
    dealt: dict[str, list[tuple[str, ...]]] = {kind: [] for kind in COUNTS}
    for kind, many in (("weak", 1), ("singles", 1), ("pairs", 2), ("triples", 3)):
        for _ in range(hands[kind]):
            names: tuple[str, ...] = ()
            while len(names) < many:
                names = (*names, deal(names, measured if kind == "weak" else set(KINDS)))
            dealt[kind].append(names)
    order = [str(name) for name in rng.permutation(list(STRANGERS))]
    dealt["unmodelled"] = [(order[k % len(order)],) for k in range(hands["unmodelled"])]
    dealt["empties"] = [()] * hands["empties"]
    return dealt
