"""When unexplained structure withdraws a cause, and in which rows functions are judged: each rule alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from arm_io.types import Array
from arm_model import Arm
from diagnosis.cause import Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.model_errors import ModelUncertainty
from diagnosis.measurements.currents.search import Selection, _with_refuted
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure import spurious, unexplained
from diagnosis.measurements.currents.structure.basis_functions import shapes_of
from diagnosis.measurements.currents.structure.dominant import explained_alone, family_dominates
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.unexplained import StructureSearch, Unexplained, better_than_causes
from diagnosis.residual.generation import residual_run
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from identification.selection import Split
from tests.diagnosis import two_link
from tests.diagnosis.two_link import DRIVE, Day

NOISE, ALIKE = 0.005, Day()
"""A; the arm as its model says."""
COULOMB, VISCOUS, ASYMMETRY, SPRING, OTHER_JOINT = (
    *(Candidate(effect, 1) for effect in ("coulomb_friction", "viscous_friction", "friction_asymmetry")),
    Candidate("gravity_spring", 1),
    Candidate("coulomb_friction", 2),
)
LINK, ONE_COEFFICIENT = (
    Candidate("link_inertia", 1),
    tuple(Candidate(effect, 1) for effect in ("current_offset", "rotor_inertia", "current_gain")),
)

Law = Callable[[Array, Array], Array]
"""A at joint 1, of its angle and speed (m,)."""


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return two_link.model(root)


def _data(arm: Arm, law: Law, day: Day = ALIKE, travel: float = 1.0) -> Split[Dataset]:
    """A fitted and a held-out recording with a law more at joint 1, which does ``travel`` of its motion when fitted."""
    sides = []
    for seed, share in ((1, travel), (2, 1.0)):
        t, q, v, a = two_link.motion(seed, 12.0)
        q[:, 0] = q[0, 0] + share * (q[:, 0] - q[0, 0])
        v[:, 0], a[:, 0] = share * v[:, 0], share * a[:, 0]
        current = two_link.torque(q, v, a, day) / DRIVE + NOISE * np.random.default_rng(seed).normal(size=q.shape)
        current[:, 0] += law(q[:, 0], v[:, 0])
        sides.append(dataset_of([residual_run(f"{seed}", arm, t, q, current)]))
    return Split(*sides)


def _state(arm: Arm, data: Split[Dataset], chosen: Sequence[Candidate], left_over: float | None = None) -> State:
    """Chosen candidates; left_over: of an identified model, squares of the noise that it left at joint 1."""
    known = None
    if left_over is not None:
        exact = data.map(lambda side: np.zeros((len(side.y), 0)))
        known = ModelUncertainty(exact, np.array([left_over, 0.0]))
    model = Currents(arm, data, Library(chosen, data), [], uncertain=known)
    return model.refitted(chosen, {c.key: [] for c in chosen})


def _wave(amplitude: float) -> Law:
    """Over the angle: of no effect of the catalogue."""
    return lambda q, v: amplitude * np.sin(6.0 * q)


@pytest.mark.parametrize(
    ("joint", "structure", "share"),
    [
        (1, Structure(Signal.CURRENT, 1, NO_VARIABLE, 0.0), LIMITS.superfluous * 4.0 / 16.0),
        (1, Structure(Signal.CURRENT, 1, "position", 0.4), None),
        (1, Structure(Signal.CURRENT, 2, NO_VARIABLE, 0.0), None),
        (None, Structure(Signal.CURRENT, 1, NO_VARIABLE, 0.0), None),
    ],
)
def test_a_cause_beside_a_residual_of_no_variable_is_held_against_that_residual(
    joint: int | None, structure: Structure, share: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It gains 4 of 16 that are left at its joint, of 36 in all."""
    model = SimpleNamespace(
        without=lambda c, state: SimpleNamespace(fitted=None),
        columns=lambda c: SimpleNamespace(fit=None),
        limits=LIMITS,
    )
    held_out = SimpleNamespace(of=lambda joint: slice(4 * joint - 4, 4 * joint))
    residual = SimpleNamespace(held_out=np.array([2.0] * 4 + [5.0**0.5] * 4))
    state = SimpleNamespace(model=model, data=SimpleNamespace(held_out=held_out), residual=residual)
    monkeypatch.setattr(spurious, "score", lambda *_: SimpleNamespace(gain=4.0))
    found = spurious._share_beside(
        cast(Any, SimpleNamespace(joint=joint)), cast(Any, state), Unexplained([structure], [], {}), ()
    )
    assert found == share


def test_level_and_slope_of_friction_are_nearly_all_of_it_together(arm: Arm) -> None:
    data = _data(arm, lambda q, v: 0.0 * q, Day(coulomb=(2.0, 1.0), viscous=(3.0, 0.0)))
    state = _state(arm, data, (SPRING, COULOMB, VISCOUS, OTHER_JOINT))
    assert all(explained_alone([c], state) < LIMITS.dominant for c in (COULOMB, VISCOUS))
    assert family_dominates(COULOMB, "velocity", state) and family_dominates(VISCOUS, "velocity", state)
    # a law of another variable is none of them, however much they explain
    assert not family_dominates(SPRING, "velocity", state) and not family_dominates(COULOMB, "position", state)
    with_wave = _data(arm, _wave(0.3), Day(coulomb=(2.0, 1.0), viscous=(3.0, 0.0)))
    assert not family_dominates(COULOMB, "velocity", _state(arm, with_wave, (OTHER_JOINT, COULOMB, VISCOUS)))


@pytest.mark.parametrize(
    ("amplitude", "left_over", "outdone"),
    [
        (0.005, None, True),  # 2.0 times the noise
        (0.005, 1.0, False),
        (0.015, 1.0, True),  # 5.4 times the noise
        (0.015, 4.0, False),
    ],
)
def test_within_what_an_identified_model_leaves_friction_keeps_its_name(
    arm: Arm, amplitude: float, left_over: float | None, outdone: bool
) -> None:
    """2.5 times what such a model leaves is no proof that a wave over the angle is there in the place of friction."""
    data = _data(arm, _wave(amplitude), Day(coulomb=(0.1, 0.0)))
    state = _state(arm, data, (COULOMB,), left_over)
    assert spurious._outdone(state, (COULOMB,), Bases(*data)) == ([COULOMB] if outdone else [])


def test_a_function_that_explains_what_an_identified_model_leaves_outdoes_no_cause(arm: Arm) -> None:
    """It follows the residual of any day."""
    data = _data(arm, _wave(0.1))
    state, bases = _state(arm, data, (SPRING,)), Bases(*data)
    better = better_than_causes(bases, replace(state, chosen=()).fitted, state.fitted, arm, 1, 0.0)
    variances = max(better.values()) / data.held_out.rows
    assert variances > 1000.0
    for left_over, outdone in ((None, [SPRING]), (variances - 0.5, [SPRING]), (variances + 0.5, [])):
        assert spurious._outdone(_state(arm, data, (SPRING,), left_over), (), bases) == outdone


@pytest.mark.parametrize(
    ("chosen", "share"),
    [
        ((ASYMMETRY, COULOMB), 0.0),  # five coefficients
        ((COULOMB, VISCOUS, *ONE_COEFFICIENT[:2]), 0.0),
        ((COULOMB, VISCOUS, *ONE_COEFFICIENT), LIMITS.many_leave),
        ((ASYMMETRY, SPRING), LIMITS.many_leave),
        ((ASYMMETRY, SPRING, OTHER_JOINT), LIMITS.many_leave),
    ],
)
def test_many_coefficients_of_a_joint_must_leave_less_than_one_function(
    arm: Arm, chosen: Sequence[Candidate], share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = _state(arm, _data(arm, _wave(0.02)), chosen)
    assert _allowed(state, monkeypatch) == pytest.approx(share * _left(state))


def test_many_coefficients_of_one_cause_are_those_of_its_law(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three of a link that turns about a horizontal axis; of a link of any arm up to ten."""
    monkeypatch.setattr(spurious, "LIMITS", replace(LIMITS, many=2))
    for chosen, share in (((LINK,), 0.0), ((LINK, COULOMB), LIMITS.many_leave)):
        state = _state(arm, _data(arm, _wave(0.02)), chosen)
        assert _allowed(state, monkeypatch) == pytest.approx(share * _left(state))


def _left(state: State) -> float:
    """Squared held-out residual of joint 1."""
    return float(np.sum(state.residual.held_out[state.data.held_out.of(1)] ** 2))


def _allowed(state: State, monkeypatch: pytest.MonkeyPatch) -> float:
    """Squares by which a function may be worse than the causes of joint 1; of other joints it may not."""
    allowances = dict[int, float]()

    def better(*given: Any) -> dict[str, float]:
        *_, joint, allowed = given
        allowances[joint] = allowed
        return {}

    monkeypatch.setattr(spurious, "better_than_causes", better)
    assert spurious._outdone(state, (), Bases(*state.data)) == [] and allowances.get(2, 0.0) == 0.0
    return allowances[1]


def test_a_function_may_leave_more_than_many_causes_but_not_one_of_the_velocity(arm: Arm) -> None:
    laws: dict[str, tuple[Law, Candidate]] = {
        "position": (lambda q, v: 0.2 * q, SPRING),
        "velocity": (lambda q, v: 0.1 * v, VISCOUS),
    }
    for variable, (law, right) in laws.items():
        data = _data(arm, law)
        state, bases = _state(arm, data, (right,)), Bases(*data)
        without = replace(state, chosen=()).fitted
        allowed = LIMITS.many_leave * float(np.sum(state.residual.held_out**2))
        strict, lenient = (better_than_causes(bases, without, state.fitted, arm, 1, more) for more in (0.0, allowed))
        assert not strict
        assert (variable in lenient) is (variable == "position")


def test_beyond_the_fitted_range_no_function_is_held_against_causes(arm: Arm) -> None:
    """An error there says nothing of a function that does not reach so far."""
    data = _data(arm, lambda q, v: 0.0 * q, travel=0.4)
    state, bases = _state(arm, data, (SPRING,)), Bases(*data)
    q, fitted = data.held_out.at_joint("q", 1), data.fit.at_joint("q", 1)
    beyond = (q < fitted.min()) | (q > fitted.max())
    assert 0.2 < beyond.mean() < 0.8
    wrong = state.residual.held_out.copy()
    wrong[data.held_out.of(1)] += 5.0 * beyond
    with_causes = replace(state.fitted, residual=Split(state.residual.fit, wrong))
    better = better_than_causes(bases, replace(state, chosen=()).fitted, with_causes, arm, 1, 0.0)
    assert better and "position" not in better


def test_functions_are_judged_where_they_and_those_before_them_are_known(arm: Arm) -> None:
    data = _data(arm, _wave(0.1))
    state, bases = _state(arm, data, ()), Bases(*data)
    search = StructureSearch(data, state.fitted, arm, state.significance, bases)
    every, none = np.ones(data.held_out.rows, bool), np.zeros(data.held_out.rows, bool)
    shapes = [one for one in shapes_of(bases, data.fit.y, arm, 1) if one.name == "position"]
    found = search._strongest(1, shapes, state.fitted, every)
    assert found is not None and found[0].name == "position" and found[1] > 0.9
    assert search._strongest(1, shapes, state.fitted, none) is None
    assert search._strongest(1, [replace(one, known=none) for one in shapes], state.fitted, every) is None


@pytest.mark.parametrize(("travel", "found"), [(1.0, ["position", "velocity"]), (0.45, ["position"])])
def test_beyond_the_range_of_one_structure_no_further_one_is_found(
    arm: Arm, travel: float, found: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A function of the position that ends where the fitted range does, and one of the velocity.

    In the rows of that range, the second explains less than a structure must of all rows.
    """
    start, *_ = angles = two_link.motion(1, 12.0)[1][:, 0]
    low, high = (start + travel * (end - start) for end in (angles.min(), angles.max()))
    data = _data(
        arm, lambda q, v: 0.012 * np.sin(9.0 * q) * (q > low) * (q < high) + 0.0021 * np.sin(4.0 * v), travel=travel
    )
    state, bases = _state(arm, data, ()), Bases(*data)
    first = {one.name: one for one in reversed(list(shapes_of(bases, data.fit.y, arm, 1)))}
    monkeypatch.setattr(unexplained, "shapes_of", lambda *_: [first["position"], first["velocity"]])
    search = StructureSearch(data, state.fitted, arm, state.significance, bases)
    assert [one.against for one in search.at(1)[0]] == found


def test_the_structure_of_refuted_causes_takes_the_place_of_what_explains_less(arm: Arm) -> None:
    def of(joint: int, against: str, share: float) -> Structure:
        return Structure(Signal.CURRENT, joint, against, share)

    refuted = {
        SPRING.key: of(1, "position", 0.6),
        COULOMB.key: of(1, "position", 0.6),
        OTHER_JOINT.key: of(2, "v", 0.5),
    }
    larger, smaller, same, elsewhere = of(1, "time", 0.6), of(1, "load torque", 0.5), of(2, "v", 0.7), of(3, "q", 0.1)
    left = Unexplained([larger, smaller, same, elsewhere], [], {})
    found = _with_refuted(Selection(cast(Any, None), left), refuted)
    assert found.unexplained.structures == [larger, same, elsewhere, refuted[SPRING.key]]
    assert found.refuted == refuted
