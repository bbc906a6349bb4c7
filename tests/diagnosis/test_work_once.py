"""Work that a diagnosis does not do twice, or not at all: what it finds is the same with it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from arm_io.types import Array
from arm_model import Arm
from diagnosis.measurements.currents import state as states
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure import unexplained
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.residual.noise.encoder_step import found_once
from diagnosis.screening.lost_rows.lag_path import MOST, PIECE, _errors
from diagnosis.selection.candidate import Candidate
from diagnosis.verification import final_gain, tenable
from identification.selection import Split
from tests.diagnosis import two_link
from tests.diagnosis.two_link import Day, residual_of

TRUE, IDLE = Candidate("coulomb_friction", 1), Candidate("viscous_friction", 2)


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return two_link.model(root)


def _model(arm: Arm, day: Day, *library: Candidate) -> Currents:
    data = Split(*(dataset_of([residual_of(arm, seed, day)]) for seed in (1, 2)))
    return Currents(arm, data, Library(library, data), [])


def _counted(monkeypatch: pytest.MonkeyPatch, module: object, name: str) -> list[object]:
    """One entry for each call of a function from now on."""
    calls, function = list[object](), getattr(module, name)

    def counted(*args: object, **kwargs: object) -> object:
        calls.append(args)
        return function(*args, **kwargs)

    monkeypatch.setattr(module, name, counted)
    return calls


@pytest.mark.parametrize(("ripple", "searches"), [(0.0, 1), (0.3, 2)])
def test_structure_is_searched_for_once_where_there_is_none(
    arm: Arm, monkeypatch: pytest.MonkeyPatch, ripple: float, searches: int
) -> None:
    """A cause that the final model does not need goes before; where there is structure, beside all of them as well."""
    model = _model(arm, Day(coulomb=(6.0, 0.0), ripple=ripple), TRUE, IDLE)
    state = model.refitted([TRUE, IDLE], {TRUE.key: [], IDLE.key: []})
    calls = _counted(monkeypatch, tenable, "without_spurious")
    found, _ = tenable._with_structure(tenable._final_model(state), Bases(*model.data), lambda sentence: None)
    assert len(calls) == searches
    assert bool(found.unexplained.structures) is (ripple > 0.0)
    assert IDLE not in found.state.chosen or ripple


def test_gains_in_the_final_model_are_computed_once_where_all_matter(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """The search, what it leaves unexplained and the closed loop ask for those of the same model."""
    model = _model(arm, Day(coulomb=(6.0, 0.0)), TRUE)
    calls = _counted(monkeypatch, final_gain, "_gains")
    found, causes = tenable.tenable_causes(model, Split([], []), model.data.held_out.runs, lambda sentence: None)
    assert found.state.chosen == (TRUE,) and [cause.key for cause in causes] == [TRUE.key]
    assert len(calls) == 1


@pytest.mark.parametrize("coulomb", [1.0, 6.0])
def test_a_correction_that_would_change_nothing_is_not_computed(
    arm: Arm, monkeypatch: pytest.MonkeyPatch, coulomb: float
) -> None:
    model = _model(arm, Day(coulomb=(coulomb, 0.0)), TRUE)
    start = State(model, (TRUE,), model.data, {})
    calls = _counted(monkeypatch, states, "_exact")
    once, few = states.corrected(start), len(calls)
    monkeypatch.setattr(states, "CONVERGED", 0.0)
    twice = states.corrected(start)
    assert (few, len(calls) - few) == (2, 4)
    assert np.sqrt(np.mean((once.data.fit.y - twice.data.fit.y) ** 2)) < 0.01
    assert once.coefficients[0] == pytest.approx(twice.coefficients[0], rel=1e-4)


@pytest.mark.parametrize("ripple", [0.0, 0.3, 1.0])
def test_functions_that_do_not_follow_fitted_recordings_are_not_tried_on_others(
    arm: Arm, monkeypatch: pytest.MonkeyPatch, ripple: float
) -> None:
    model = _model(arm, Day(ripple=ripple), TRUE)
    found = []
    for hardly in (unexplained.HARDLY, -np.inf):
        monkeypatch.setattr(unexplained, "HARDLY", hardly)
        calls = _counted(monkeypatch, unexplained, "residual_with")
        state = State(model, (), model.data, {})
        search = unexplained.StructureSearch(state.data, state.fitted, arm, state.significance, Bases(*model.data))
        of_joints = search.of_all_joints()
        found.append((of_joints.structures, len(calls)))
    assert found[0][0] == found[1][0]
    assert bool(found[0][0]) is (ripple > 0.0)
    assert ripple or found[0][1] < 0.5 * found[1][1]


def test_samples_are_asked_once_for_every_other_argument() -> None:
    asked: list[float] = []

    @found_once
    def scaled(values: Array, by: float) -> float:
        asked.append(by)
        return by * float(values.sum())

    values = np.ones(3)
    assert [scaled(values, 2.0), scaled(values.copy(), 2.0), scaled(values, 3.0)] == [6.0, 6.0, 9.0]
    assert asked == [2.0, 3.0]


def test_errors_by_lag_are_those_of_every_row() -> None:
    """Of currents about 10 A, against sums over the rows of each piece; at the ends, over those that there are."""
    rng, rows, longest = np.random.default_rng(5), 8 * PIECE, 3 * PIECE
    expected = 10.0 + np.cumsum(rng.normal(size=(rows, 2)), axis=0)
    run = SimpleNamespace(t=np.arange(rows), expected=expected, current=expected + 0.1 * rng.normal(size=(rows, 2)))
    pieces = np.arange(0, rows - PIECE + 1, PIECE)
    found = _errors(run, np.ones_like(expected), pieces, longest)  # type: ignore[arg-type]
    compared = 0
    for lag in range(-longest, longest + 1):
        for p, first in enumerate(pieces.tolist()):
            here = np.arange(first, first + PIECE)
            here = here[(here + lag >= 0) & (here + lag < rows)]
            if len(here) < MOST * PIECE:
                continue
            apart = run.current[here] - run.expected[here + lag]
            direct = PIECE * (np.mean(apart**2, axis=0) - np.mean(apart, axis=0) ** 2)
            np.testing.assert_allclose(found[lag + longest, p], direct, rtol=1e-6, atol=1e-8)
            compared += 1
    assert compared > 1500
