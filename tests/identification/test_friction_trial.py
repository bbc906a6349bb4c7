"""Whether richer friction laws stay at the joints of one arm: of those that do, few are there by chance."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from identification.methods.friction_trial import trials_of
from identification.methods.held_out import Comparison

JOINTS = 4


class _Compared:
    """Residuals of one row per joint: halved by the richer law, with a probability by chance per joint."""

    rows = SimpleNamespace(joint=np.arange(JOINTS), speed=lambda: np.ones(JOINTS))

    def __init__(self, chances: list[float | None]) -> None:
        self._chances = chances

    def on(self, chosen: Any) -> Comparison | None:
        """Of the one joint that is chosen."""
        chance = self._chances[int(np.flatnonzero(chosen)[0])]
        return None if chance is None else Comparison(before=1.0, after=0.5, p=chance)


@pytest.mark.parametrize(
    ("chances", "stay"),
    [
        ([1e-6, 1e-6, 0.004, 0.2], [True, True, True, False]),
        ([0.004, 0.3, 0.4, 0.5], [False] * JOINTS),
        ([0.004, None, None, None], [True, False, False, False]),
    ],
)
def test_drives_of_one_arm_are_alike(chances: list[float | None], stay: list[bool]) -> None:
    compared = cast(Any, _Compared(chances))
    trials = trials_of(compared, compared, dict.fromkeys(range(JOINTS), 0.1), np.ones(JOINTS))
    assert [trial.stays for trial in trials] == stay
    assert [trial.joint for trial in trials] == list(range(1, JOINTS + 1))


def test_where_no_joint_has_one_some_get_one_in_one_arm_of_a_hundred() -> None:
    rng, arms = np.random.default_rng(3), 3000
    given = 0
    for _ in range(arms):
        compared = cast(Any, _Compared(rng.uniform(size=JOINTS).tolist()))
        trials = trials_of(compared, compared, dict.fromkeys(range(JOINTS), 0.1), np.ones(JOINTS))
        given += any(trial.stays for trial in trials)
    assert given / arms < 0.015
