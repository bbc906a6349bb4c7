"""What a candidate must pass to be named, and the deviations of its parameters: each against an oracle of its own."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from arm_model import Arm, EffectTerm
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.causes import of_candidate
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.estimates import covariance_of, estimates_of
from diagnosis.measurements.currents.limits import LIMITS, matters
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.search import Selection, refitted_without, search
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.unexplained import Unexplained
from diagnosis.per_recording.candidates import contradicted, noise_alone
from diagnosis.per_recording.search import per_recording
from diagnosis.per_recording.values import ValuesPerRecording
from diagnosis.residual.other_effects import with_own
from diagnosis.residual.run import Run
from diagnosis.residual.setpoint_ripple import unseen_directions
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.contradiction import CHANCE
from diagnosis.selection.design import Dataset
from diagnosis.selection.estimates import estimates
from diagnosis.selection.regression import score
from identification.preprocessing import drifting
from identification.selection import Score, Split
from tests.diagnosis import two_link
from tests.diagnosis.two_link import Day

ROWS = 1000


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return two_link.model(root)


def _chosen(arm: Arm, candidates: Candidate | tuple[Candidate, ...], *days: Day) -> State:
    """The candidates alone, fitted to the first day; the second is held out."""
    chosen = candidates if isinstance(candidates, tuple) else (candidates,)
    fit, held_out = (dataset_of([two_link.residual_of(arm, seed, day)]) for seed, day in enumerate(days))
    data = Split(fit, held_out)
    model = Currents(arm, data, Library(chosen, data), [])
    return State(model, chosen, data, {candidate.key: () for candidate in chosen})


def test_a_search_goes_on_where_what_it_chose_is_replaced(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten coefficients of a link followed a spring, and kept it out; in the end another link took their place.

    Here, the second cause is lost when the first search is simplified.
    """
    viscous, coulomb = Candidate("viscous_friction", 1), Candidate("coulomb_friction", 1)
    model = _chosen(arm, (viscous, coulomb), *[Day(viscous=(6.0, 0.0), coulomb=(2.0, 0.0))] * 2).model
    lost = list[Candidate]()

    def without_the_last(state: State) -> State:
        if lost:
            return state
        lost.append(state.chosen[-1])
        return refitted_without(state, lost[0])

    monkeypatch.setattr("diagnosis.measurements.currents.search.simplified", without_the_last)
    assert {c.key for c in search(model, lambda _: None).chosen} == {viscous.key, coulomb.key} and lost


def test_where_a_search_stalls_two_effects_may_enter_together(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    """What two effects are that hide each other: ``test_pairs``."""
    both = Candidate("viscous_friction", 1), Candidate("coulomb_friction", 1)
    model = _chosen(arm, both, *[Day(viscous=(6.0, 0.0), coulomb=(2.0, 0.0))] * 2).model
    monkeypatch.setattr("diagnosis.measurements.currents.model.pair_of", lambda *_: list(both))
    state = model.stalled(model.start())
    assert state is not None and state.chosen == both and set(state.rivals) == {c.key for c in both}


@pytest.mark.parametrize(("size", "first"), [(0.97, "term"), (0.90, "other")])
def test_a_term_of_a_chosen_effect_comes_before_another_effect_of_the_same_gain(
    arm: Arm, monkeypatch: pytest.MonkeyPatch, size: float, first: str
) -> None:
    chosen, other = Candidate("coulomb_friction", 1), Candidate("current_offset", 1)
    state = _chosen(arm, (chosen, other), *[Day(coulomb=(2.0, 0.0))] * 2)
    state = refitted_without(state, other)
    gains = {"term": size, "other": 1.0}

    def given(self: Currents, candidate: Candidate, pair: object, of: State) -> Score[Candidate]:
        gain = gains["term" if candidate.terms else "other"] if candidate != chosen else 0.0
        return Score(candidate=candidate, gain=gain, p=0.01, blocks=np.zeros(1), coefficients=np.ones(1))

    monkeypatch.setattr(Currents, "scored", given)
    best = state.model.scores(state)[0].candidate
    assert ("term" if best.terms else "other") == first


def test_every_coefficient_of_an_effect_may_follow_what_leaked() -> None:
    side = Dataset((), (), np.zeros(2 * ROWS), np.zeros(2 * ROWS, np.intp), ROWS)
    gain, leaked = np.array([1.2 * ROWS, 0.0]), np.array([0.5 * ROWS, 0.0])
    assert matters(gain, 1, leaked, side)
    assert matters(gain, 2, leaked, side)
    assert not matters(gain, 3, leaked, side)


def test_what_an_effect_loses_at_another_joint_counts() -> None:
    side = Dataset((), (), np.zeros(2 * ROWS), np.zeros(2 * ROWS, np.intp), ROWS)
    assert matters(np.array([0.5 * ROWS, -0.2 * ROWS]), 1, np.zeros(2), side)
    assert not matters(np.array([0.5 * ROWS, -0.45 * ROWS]), 1, np.zeros(2), side)


@pytest.mark.parametrize(("mass", "named"), [(2.0, True), (-2.0, False)])
def test_a_body_of_negative_mass_does_not_enter_however_well_it_predicts(arm: Arm, mass: float, named: bool) -> None:
    payload = Candidate("payload", None)
    state = _chosen(arm, payload, *[Day(load=(mass, 0.05, 0.0))] * 2)
    nothing = state.model.start()
    found = score(payload, state.model.columns(payload), nothing.fitted, state.data.held_out)
    assert found.coefficients[0] == pytest.approx(mass, rel=0.05) and state.model.needed(found, nothing)
    assert state.model.admissible(found, nothing) is named


def test_the_error_of_a_law_is_in_the_std_of_its_parameter(arm: Arm) -> None:
    """A share of what it explains, alike within a block and independent from block to block."""
    viscous = Candidate("viscous_friction", 1)
    state = _chosen(arm, viscous, *[Day(viscous=(4.0, 0.0))] * 2)
    x, (c,) = state.model.columns(viscous).fit.x[:, 0], state.coefficients
    block = state.data.fit.block[: len(x)]
    rng = np.random.default_rng(0)
    wrong = LIMITS.systematic * rng.normal(size=(4000, block.max() + 1))
    by_law = np.std(wrong[:, block] @ (x**2) * c[0] / (x @ x))
    (variance,) = covariance_of(state)[0].ravel()
    assert 0.9 * by_law < np.sqrt(variance) < 1.5 * by_law


def test_amplitude_and_phase_scatter_as_the_coefficients_of_a_wave_do() -> None:
    wave = Candidate("gear_ripple", 1, (("order", 5.0),))
    c, covariance = np.array([3e-4, -2e-4]), 1e-10 * np.array([[1.0, 0.4], [0.4, 2.0]])
    drawn = [wave.parameters(one.tolist()) for one in np.random.default_rng(0).multivariate_normal(c, covariance, 4000)]
    exact = {p.name: p for p in estimates(wave, c.tolist(), covariance, None, systematic=0.0)}
    stated = {p.name: p for p in estimates(wave, c.tolist(), covariance, None, systematic=0.1)}
    for name in ("amplitude", "phase"):
        assert exact[name].std == pytest.approx(np.std([values[name] for values in drawn]), rel=0.05)
    assert stated["amplitude"].std == pytest.approx(np.hypot(exact["amplitude"].std, 0.1 * np.hypot(*c)))
    # a tenth of a sine beside it turns a wave by a tenth of a radian, wherever its phase is
    assert stated["phase"].std == pytest.approx(np.hypot(exact["phase"].std, 0.1))


@pytest.mark.parametrize(("second", "contradict"), [(4.1, False), (6.0, True)])
def test_values_that_differ_by_less_than_a_law_is_wrong_are_one(arm: Arm, second: float, contradict: bool) -> None:
    viscous = Candidate("viscous_friction", 1)
    state = _chosen(arm, viscous, Day(viscous=(4.0, 0.0)), Day(viscous=(second, 0.0)))
    assert (contradicted(state) is viscous) is contradict


def test_a_rival_whose_columns_are_others_is_in_no_ambiguity_group(arm: Arm) -> None:
    viscous, coulomb = Candidate("viscous_friction", 1), Candidate("coulomb_friction", 1)
    state = _chosen(arm, (viscous, coulomb), *[Day(viscous=(4.0, 0.0))] * 2)
    columns = [state.model.columns(c).fit.x[:, 0] for c in (viscous, coulomb)]
    assert 0.5 < np.corrcoef(*columns)[0, 1] < LIMITS.group_correlation
    alone = replace(state, chosen=(viscous,))
    nothing = state.model.without(viscous, alone)
    rival = score(coulomb, state.model.columns(coulomb), nothing.fitted, state.data.held_out)
    (values,) = estimates_of(alone)
    assert of_candidate(viscous, values, replace(alone, rivals={viscous.key: [rival]})).group == (viscous.key,)


def test_contradictions_are_counted_over_all_chosen_causes(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("diagnosis.per_recording.candidates.chance_of", lambda seen, place: 0.8 * CHANCE)
    both = Candidate("viscous_friction", 1), Candidate("viscous_friction", 2)
    assert contradicted(_chosen(arm, both[:1], Day(), Day())) is both[0]
    assert contradicted(_chosen(arm, both, Day(), Day())) is None


@pytest.mark.parametrize("rubs", [0.0, 0.01])
def test_values_per_recording_leave_no_more_than_one_value_does(
    arm: Arm, monkeypatch: pytest.MonkeyPatch, rubs: float
) -> None:
    """Friction of joint 2 that the search beside them does not find, within what is taken for noise, refutes them."""
    viscous, coulomb = Candidate("viscous_friction", 1), Candidate("coulomb_friction", 2)
    state = _chosen(arm, (viscous, coulomb), *[Day(viscous=(4.0, 0.0), coulomb=(0.0, rubs))] * 2)
    runs, nothing = state.all_runs, Unexplained([], [], {})

    def without_friction(runs: Sequence[Run], taken: Set[EffectKey]) -> SimpleNamespace:
        fit, held_out = (dataset_of([run]) for run in runs)
        data = Split(fit, held_out)
        return SimpleNamespace(selection=Selection(Currents(arm, data, Library((), data), []).start(), nothing))

    beside = without_friction(
        [with_own(run, [EffectTerm("viscous_friction", 1, {"viscous": 4.0})]) for run in runs], set()
    )
    assert noise_alone(beside.selection.state)
    monkeypatch.setattr("diagnosis.per_recording.search.contradicted", lambda of: viscous if of is state else None)
    monkeypatch.setattr(ValuesPerRecording, "contradict", True)
    found = per_recording(SimpleNamespace(selection=Selection(state, nothing)), runs, without_friction)
    assert (found is None) == (rubs > 0.0)


def test_a_joint_above_the_noise_in_held_out_recordings_alone_is_not_all_noise(arm: Arm) -> None:
    viscous, day = Candidate("viscous_friction", 1), Day(viscous=(4.0, 0.0))
    assert noise_alone(_chosen(arm, viscous, day, day))
    assert not noise_alone(_chosen(arm, viscous, day, Day(viscous=(4.0, 0.0), coulomb=(1.0, 0.0))))
    assert not noise_alone(_chosen(arm, viscous, Day(viscous=(4.0, 0.0), coulomb=(0.0, 1.0)), day))


def test_with_less_weight_along_what_folds_a_residual_that_has_it_is_white() -> None:
    """y = n + F u of independent n and u has the covariance 1 + F F^T, and after the weighting 1."""
    rng, t = np.random.default_rng(1), np.linspace(0.0, 10.0, 60)
    folded, ahead = 3.0 * rng.normal(size=60), rng.normal(size=60)
    basis, less = unseen_directions(folded, ahead, np.zeros((60, 2)), t)
    columns = np.column_stack([drifting(folded, t), ahead])
    weighting = np.eye(60) - basis * less @ basis.T
    covariance = np.eye(60) + columns @ columns.T
    np.testing.assert_allclose(weighting @ covariance @ weighting.T, np.eye(60), atol=1e-9)
