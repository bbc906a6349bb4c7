"""Cases of the proving ground, drawn from a seed: an arm, its friction, its log, and what is hidden."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tests.foreign.arms import ARMS, ForeignArm
from tests.foreign.hide import COUNTED, DRAWN, Hidden, hide, noise_ratio, places
from tests.foreign.log import Defects, Logger, logged
from tests.foreign.motions import targets
from tests.foreign.plant import Array, Plant, Run, healthy, run

PROTOCOLS = ("first", "second")
KINDS = ("singles", "nothing")
MOTIONS = (("waves", 16.0), ("moves", 15.0), ("waves", 12.0))
"""Kind and s of a day's recordings: two to fit, one held out."""
LEAST = 3.0
"""times the noise: what a hidden effect changes in the logged torques at least."""
MOST = 6.0
"""Largest factor by which an effect is made stronger than drawn, to reach ``LEAST``."""


@dataclass(frozen=True)
class Case:
    """One case; ``key`` seeds all that is drawn.

    protocol  first: the model knows everything but the effect. second: the model is identified by armscope from healthy
              recordings of an arm with friction of no simple law, then the effect comes
    repeated  the second day's motions are those of the first
    """

    protocol: str
    kind: str
    number: int
    key: tuple[int, ...]
    arm: ForeignArm
    logger: Logger
    plant: Plant
    effect: str | None
    joint: int | None
    repeated: bool

    @property
    def name(self) -> str:
        """As ``--only`` finds it."""
        return (
            f"{self.protocol}-{self.kind}-{self.number}-{self.arm.name}-{self.effect or 'nothing'}@{self.joint or '-'}"
        )


@dataclass(frozen=True)
class Days:
    """Logs of a healthy day (of the second protocol only) and of the day of the effect, and how strong that is."""

    before: list[dict[str, Array]]
    after: list[dict[str, Array]]
    hidden: Hidden | None
    strength: float


def cases(protocol: str, kind: str, seed: int, count: int) -> Iterator[Case]:
    """``count`` cases: arms and effects in turn, from a random place on."""
    rng = np.random.default_rng((seed, PROTOCOLS.index(protocol), KINDS.index(kind)))
    arms = list(ARMS.values())
    effects: list[str] = []
    for number in range(count):
        arm = arms[int(rng.integers(1 << 20)) % len(arms)] if number >= len(arms) else arms[number]
        effect, joint = None, None
        if kind == "singles":
            effects = effects or [str(name) for name in rng.permutation(list(DRAWN))]
            effect = next((name for name in effects if places(name, arm)), None)
            if effect is None:  # none of those left can be in this arm
                effects = [str(name) for name in rng.permutation(list(DRAWN))]
                effect = next(name for name in effects if places(name, arm))
            effects.remove(effect)
            joint = places(effect, arm)[int(rng.integers(len(places(effect, arm))))]
        key = (seed, PROTOCOLS.index(protocol), KINDS.index(kind), number)
        plant = healthy(arm) if protocol == "first" else worn_in(arm, np.random.default_rng((*key, 1)))
        where = logger(np.random.default_rng((*key, 2)))
        yield Case(protocol, kind, number, key, arm, where, plant, effect, joint, bool(rng.uniform() < 0.5))


def logger(rng: np.random.Generator) -> Logger:
    """A controller's log."""
    rate = float(rng.choice([125.0, 250.0, 500.0, 1000.0], p=[0.3, 0.3, 0.3, 0.1]))
    return Logger(
        rate=rate,
        jitter=float(rng.choice([0.0, 0.02, 0.1])),
        currents=bool(rng.uniform() < 0.5),
        filter=str(rng.choice(["mean", "both", "none"] if rate >= 500 else ["mean", "both"])),
        demands=bool(rng.uniform() < 0.5),
        noise=float(rng.uniform(0.002, 0.008)),
        colour=float(rng.uniform(0.0, 0.6)),
        memory=float(rng.uniform(0.01, 0.05)),
        digits=float(rng.choice([1e-4, 1e-3])),
        period=float(rng.choice([0.004, 0.008])),
        bandwidth=float(rng.uniform(18.0, 30.0)),
    )


def worn_in(arm: ForeignArm, rng: np.random.Generator) -> Plant:
    """The arm with friction as arms have it.

    By the case all drives follow a constant, a hump and |v|^0.6, or the sigmoid of Gaz et al. (2019) above a small
    constant; and each has a ripple of one to three per cent of its dry friction.
    """
    plant = healthy(arm)
    count, dry = len(arm.joints), plant.friction.level
    fastest = np.array([joint.speed for joint in arm.joints])
    if rng.uniform() < 0.6:
        friction = replace(
            plant.friction,
            level=0.8 * dry,
            hump=rng.uniform(0.1, 0.4, count) * dry,
            stribeck=rng.uniform(0.03, 0.1, count) * fastest,
            power=rng.uniform(0.5, 1.2, count) * dry / fastest**0.6,
            viscous=0.2 * plant.friction.viscous,
        )
    else:
        friction = replace(
            plant.friction,
            level=0.25 * dry,
            sigmoid=rng.uniform(1.2, 2.0, count) * dry,
            steep=rng.uniform(8.0, 40.0, count) / fastest,
            shift=rng.uniform(-0.03, 0.03, count) * fastest,
            viscous=rng.uniform(0.3, 0.8, count) * plant.friction.viscous,
        )
    turn = np.array([0.05 if joint.prismatic else 2 * np.pi for joint in arm.joints])
    return replace(
        plant,
        friction=friction,
        ripple=rng.uniform(0.01, 0.03, count) * dry,
        cycles=rng.integers(20, 101, count) * np.where(turn < 1.0, 2 * np.pi / turn / 20, 1.0),
        phase=rng.uniform(-3.0, 3.0, count),
    )


def recorded(case: Case) -> Days:
    """Simulates and logs both days; the effect is made stronger until its noise ratio reaches ``LEAST``."""
    count = len(case.arm.joints)
    none = Defects.none(count)
    motions = [(*case.key, 10 + number) for number in range(3)]
    before: list[dict[str, Array]] = []
    if case.protocol == "second":
        first = motions if case.repeated else [(*key, 5) for key in motions]
        before = [day_log(case, case.plant, none, number, key, day=0) for number, key in enumerate(first)]
    if case.effect is None:
        after = [day_log(case, case.plant, none, number, key, day=1) for number, key in enumerate(motions)]
        return Days(before, after, None, 0.0)
    hidden, strength = strong_enough(case, motions[0])
    plant, defects = hide(case.plant, none, hidden)
    after = [day_log(case, plant, defects, number, key, day=1) for number, key in enumerate(motions)]
    return Days(before, after, hidden, strength)


def day_log(
    case: Case, plant: Plant, defects: Defects, number: int, key: tuple[int, ...], *, day: int
) -> dict[str, Array]:
    target, moved = _moved(case, plant, number, key)
    return logged(moved, target, case.logger, defects, _seed((*case.key, 20 + number, day)), case.arm)


def _moved(case: Case, plant: Plant, number: int, key: tuple[int, ...]) -> tuple[Array, Run]:
    kind, seconds = MOTIONS[number]
    target = targets(case.arm, kind, _seed(key), seconds, case.logger.period)
    return target, run(plant, target, case.logger.bandwidth)


def _seed(key: tuple[int, ...]) -> int:
    return int(np.random.default_rng(key).integers(1 << 30))


def strong_enough(case: Case, key: tuple[int, ...]) -> tuple[Hidden, float]:
    """The effect, and how many times the noise it changes the logged torques of the first motion.

    Where it stays below ``LEAST`` at the drawn joint, at another one; at the last if it does so everywhere.
    """
    assert case.effect is not None
    others = [joint for joint in places(case.effect, case.arm) if joint != case.joint]
    target, plain = _moved(case, case.plant, 0, key)
    for joint in [case.joint, *others]:
        hidden, reached = _scaled(replace(case, joint=joint), target, plain)
        if reached >= LEAST:
            break
    return hidden, reached


def _scaled(case: Case, target: Array, plain: Run) -> tuple[Hidden, float]:
    """The effect at its joint, made stronger by ``MOST`` at most, and its noise ratio."""
    none = Defects.none(len(case.arm.joints))
    quiet = replace(case.logger, noise=0.0, digits=1e-9, jitter=0.0)
    reference = logged(plain, target, quiet, none, 0, case.arm)["tau"]
    size, reached = 1.0, 0.0
    for _ in range(4):
        hidden = _drawn(case, size, reference)
        if hidden.effect in COUNTED:
            return hidden, LEAST
        plant, defects = hide(case.plant, none, hidden)
        moved = plain if plant is case.plant else run(plant, target, case.logger.bandwidth)
        seen = logged(moved, target, quiet, defects, 0, case.arm)["tau"]
        reached = noise_ratio(seen, reference, case.logger.deviation(case.arm), case.joint)
        if reached >= LEAST or size >= MOST:
            break
        size = min(size * 1.2 * LEAST / max(reached, 0.1), MOST)
    return hidden, reached


def _drawn(case: Case, size: float, torque: Array) -> Hidden:
    """The effect at a magnitude; a limit lies below the largest torque (m, n) of its drive."""
    assert case.effect is not None
    values = DRAWN[case.effect](np.random.default_rng((*case.key, 3)), case.arm, (case.joint or 1) - 1, size)
    if case.effect == "current_limit":
        largest = np.quantile(np.abs(torque[:, (case.joint or 1) - 1]), 0.998)
        values = {"limit": values["share"] * float(largest)}
    if case.effect == "dropped_trigger":
        values = {"time": values["time"], "rows": float(max(round(values["seconds"] * case.logger.rate), 1))}
    return Hidden(case.effect, case.joint, values)
