"""Two effects hidden in one arm: how often a second name is right, single effects cannot say."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.foreign.cases import MOTIONS, Case, Days, cases, day_log, strong_enough
from tests.foreign.ended import unrendered
from tests.foreign.hide import DRAWN, Hidden, hide, places
from tests.foreign.log import Defects
from tests.foreign.score import SAME
from tests.foreign.through import Results, through

ONE_SPRING = {"joint_compliance", "backlash"}
"""A plant has one of them, at one joint."""


@dataclass(frozen=True)
class Pair:
    """A case with one effect, and the same arm with another one; both of the first protocol."""

    first: Case
    second: Case

    @property
    def name(self) -> str:
        """As ``--only`` finds it."""
        one, other = self.first, self.second
        each = "+".join(f"{case.effect}@{case.joint or '-'}" for case in (one, other))
        return f"{one.protocol}-pairs-{one.number}-{one.arm.name}-{each}"


def pairs(seed: int, count: int) -> Iterator[Pair]:
    """The single effects of this seed, each with another one that no name of it stands for, at any joint."""
    for case in cases("first", "singles", seed, count):
        key = (*case.key, 1)
        rng = np.random.default_rng(key)
        alike = [*SAME, ONE_SPRING, {case.effect}]
        taken = {name for same in alike if case.effect in same for name in same}
        names = [name for name in rng.permutation(list(DRAWN)) if name not in taken and places(str(name), case.arm)]
        several = places(effect := str(names[0]), case.arm)
        joint = several[int(rng.integers(len(several)))]
        yield Pair(case, replace(case, effect=effect, joint=joint, key=key))


def logs(pair: Pair) -> tuple[list[Hidden], Days]:
    """The two effects, each as strong as it would be alone, and the logs of an arm that has both."""
    case, hidden = pair.first, list[Hidden]()
    motions = [(*case.key, 10 + number) for number in range(len(MOTIONS))]
    plant, defects = case.plant, Defects.none(len(case.arm.joints))
    strengths = []
    for one in (pair.first, pair.second):
        own, strength = strong_enough(one, motions[0])
        plant, defects = hide(plant, defects, own)
        hidden.append(own)
        strengths.append(strength)
    after = [day_log(case, plant, defects, number, key, day=1) for number, key in enumerate(motions)]
    return hidden, Days([], after, None, min(strengths))


def diagnosed(pair: Pair) -> tuple[list[Hidden], Results]:
    """The two effects, and what the commands wrote of the arm."""
    hidden, days = logs(pair)
    with tempfile.TemporaryDirectory() as folder, unrendered():
        return hidden, through(pair.first, days, Path(folder), compare=False)
