"""Friction that builds up over a distance, in the place of several effects whose sum imitates it."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from arm_model import Arm, EffectTerm
from diagnosis import find_causes
from diagnosis.cause import Cause
from diagnosis.current_diagnosis import CurrentDiagnosis
from diagnosis.measurements.near_rest.friction import friction_causes
from diagnosis.outside_selection import friction_in_place
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.search import Search
from identification.selection import Split
from tests.diagnosis.one_axis import built_up, vertical_joint
from tests.diagnosis.runs import group_of

RATE, ROTOR, COULOMB, VISCOUS, STIFFNESS, DAMPING = 500.0, 2.0, 10.0, 5.0, 80.0, 12.0
LAW = "presliding_friction", 1
IMITATION = [
    EffectTerm("current_gain", 1, {"error": 1.0}),
    EffectTerm("friction_asymmetry", 1, {"positive": -6.0, "negative": -6.0}),
]


def _runs(damping: float = 0.0) -> Split[list[Run]]:
    """Two recordings fitted and one held out, whose friction builds up over 125 mrad."""
    arm, runs = Arm("axis", (vertical_joint(ROTOR, COULOMB, VISCOUS, 0.01),)), []
    for seed in range(3):
        rng, t = np.random.default_rng(seed), np.arange(0.0, 12.0, 1 / RATE)
        rates, size = 2 * np.pi * rng.uniform(0.3, 0.9, 3), np.array([0.3, 0.15, 0.1])
        phase = np.outer(t, rates) + rng.uniform(0, 6, 3)
        q, v, a = np.sin(phase) @ size, np.cos(phase) @ (size * rates), -np.sin(phase) @ (size * rates**2)
        friction = built_up(v, COULOMB, STIFFNESS, RATE)
        # bristles that hold F turn at q' - s0 |q'| z / F
        friction += damping * (v - np.abs(v) * friction / COULOMB)
        i = ROTOR * a + VISCOUS * v + friction + 0.1 * rng.normal(size=len(t))
        runs.append(residual_run(f"{seed}", arm, t, np.round(q / 2e-5)[:, None] * 2e-5, i[:, None]))
    return Split(runs[:2], runs[2:])


@dataclass
class _Found:
    """What a search found: the imitation, or what the law leaves of it."""

    runs: Split[list[Run]]
    causes: list[Cause]
    held_out: float = 100.0
    by_selection: bool = True
    library: tuple[Any, ...] = ()
    terms: list[EffectTerm] = field(default_factory=lambda: list(IMITATION))

    @property
    def state(self) -> SimpleNamespace:
        return SimpleNamespace(runs=self.runs, terms=self.terms, energy=Split(0.0, self.held_out))


@pytest.fixture(scope="module")
def runs() -> Split[list[Run]]:
    return _runs()


def _searched(runs: Split[list[Run]], *causes: Cause, held_out: float = 100.0) -> CurrentDiagnosis:
    return cast(CurrentDiagnosis, _Found(runs, list(causes), held_out))


def test_the_law_is_judged_without_the_effects_that_imitate_it(runs: Split[list[Run]]) -> None:
    imitation = _searched(runs, *(group_of((term.name, 1)) for term in IMITATION))
    (law,) = friction_in_place(imitation, frozenset())
    assert law.key == LAW
    stiffness = law.parameters[0]
    assert abs(stiffness.value - STIFFNESS) < 2 * stiffness.std < 0.5 * STIFFNESS
    # beside them it is not what the currents show
    beside = friction_causes(runs, IMITATION, (), ()).causes
    assert not any(abs(one.parameters[0].value - STIFFNESS) < 0.2 * STIFFNESS for one in beside)


def test_one_effect_of_a_joint_has_no_law_in_its_place(runs: Split[list[Run]]) -> None:
    assert (
        friction_in_place(_searched(runs, group_of(("current_gain", 1)), group_of(("current_gain", 2))), frozenset())
        == []
    )


def test_bristles_that_the_selection_named_get_their_damping() -> None:
    runs = _runs(DAMPING)
    named = _Found(runs, [group_of(LAW)], terms=[EffectTerm(*LAW, {"stiffness": STIFFNESS})])
    (law,) = friction_in_place(cast(CurrentDiagnosis, named), frozenset())
    damping = next(one for one in law.parameters if one.name == "damping")
    assert law.key == LAW
    assert abs(damping.value - DAMPING) < 2 * damping.std < DAMPING


def test_an_excluded_law_takes_no_place(runs: Split[list[Run]]) -> None:
    imitation = _searched(runs, *(group_of((term.name, 1)) for term in IMITATION))
    assert friction_in_place(imitation, frozenset({LAW})) == []


@pytest.mark.parametrize(
    ("left", "others", "taken"), [(100.0, 0, True), (80.0, 0, True), (110.0, 0, False), (80.0, 1, False)]
)
def test_it_takes_their_place_where_it_leaves_no_more_with_fewer_causes(
    runs: Split[list[Run]], monkeypatch: pytest.MonkeyPatch, left: float, others: int, taken: bool
) -> None:
    imitation = _searched(runs, *(group_of((term.name, 1)) for term in IMITATION))
    after = _searched(runs, *(group_of(("cogging", 2)) for _ in range(others)), held_out=left)
    monkeypatch.setattr(find_causes, "searched", lambda search: after)
    none = cast(Any, None)
    search = Search(
        model=none, given=(), excluded=frozenset(), recordings=none, screened=none, progress=lambda text: None
    )
    found = find_causes._friction_in_place(find_causes.Found(search, imitation, frozenset()))
    assert found.currents is (after if taken else imitation)
    assert [cause.key for cause in found.search.near_rest] == ([LAW] if taken else [])
    assert (LAW in found.search.excluded) == taken


@pytest.mark.parametrize(("others", "taken"), [(0, True), (1, False)])
def test_a_law_that_was_named_is_taken_with_all_its_parameters(
    runs: Split[list[Run]], monkeypatch: pytest.MonkeyPatch, others: int, taken: bool
) -> None:
    named = _searched(runs, group_of(LAW))
    after = _searched(runs, *(group_of(("cogging", 2)) for _ in range(others)))
    monkeypatch.setattr(find_causes, "searched", lambda search: after)
    none = cast(Any, None)
    search = Search(
        model=none, given=(), excluded=frozenset(), recordings=none, screened=none, progress=lambda text: None
    )
    found = find_causes._friction_in_place(find_causes.Found(search, named, frozenset()))
    assert [cause.key for cause in found.search.near_rest] == ([LAW] if taken else [])
