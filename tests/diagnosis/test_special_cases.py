"""An effect and its special cases: which of them a search names where both explain the recordings."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm_model import Arm
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.replacement.special_cases import special_cases
from diagnosis.measurements.currents.state import State
from diagnosis.selection.candidate import Candidate
from identification.selection import Split
from tests.diagnosis import two_link
from tests.diagnosis.two_link import Day

ASYMMETRY = Candidate("friction_asymmetry", 1)
COULOMB, VISCOUS, OFFSET = (Candidate(name, 1) for name in ("coulomb_friction", "viscous_friction", "current_offset"))


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return two_link.model(root)


def _chosen(arm: Arm, chosen: tuple[Candidate, ...], day: Day) -> State:
    """The candidates of a day, fitted to one motion; another is held out."""
    data = Split(*(dataset_of([two_link.residual_of(arm, seed, day)]) for seed in (1, 2)))
    model = Currents(arm, data, Library((ASYMMETRY, COULOMB, VISCOUS, OFFSET), data), [])
    return model.refitted(chosen, {c.key: () for c in chosen})


def _named(state: State) -> set[str]:
    return {c.effect for c in special_cases(state).chosen}


def test_a_level_and_an_offset_are_friction_that_differs_between_directions(arm: Arm) -> None:
    of_one_direction = Day(positive=(2.0, 0.0))
    assert _named(_chosen(arm, (COULOMB, OFFSET), of_one_direction)) == {ASYMMETRY.effect}


def test_friction_that_grew_alike_in_both_directions_is_no_asymmetry(arm: Arm) -> None:
    grown = Day(coulomb=(2.0, 0.0), viscous=(4.0, 0.0))
    assert _named(_chosen(arm, (ASYMMETRY,), grown)) == {COULOMB.effect, VISCOUS.effect}


@pytest.mark.parametrize(
    ("ripple", "positive", "named"), [(0.0, 0.1, ASYMMETRY), (0.01, 0.1, COULOMB), (0.01, 0.4, ASYMMETRY)]
)
def test_directions_that_differ_by_less_than_what_nothing_explains_are_equal(
    arm: Arm, ripple: float, positive: float, named: Candidate
) -> None:
    """ripple: of all friction over the angle, which none of the candidates follows."""
    day = Day(coulomb=(2.0, 0.0), ripple=ripple, positive=(positive, 0.0))
    assert _named(_chosen(arm, (ASYMMETRY,), day)) == {named.effect}
