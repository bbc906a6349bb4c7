"""Causes beside a model that says how well it is known: named only if they are beyond that.

Recordings of an arm that shares no effect code (``tests.diagnosis.two_link``), and plain matrices with a known answer.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import armscope
from arm_model import Arm, FrictionCurve, parameter, with_parameters, write_model
from arm_model.tables import uncertainty_of
from daq.recording import Recording
from diagnosis import find_causes, outside_selection
from diagnosis.current_diagnosis import CurrentDiagnosis
from diagnosis.measurements.currents.model_errors import ModelUncertainty, Significance, of_strongest
from diagnosis.measurements.near_rest.friction import Friction
from diagnosis.residual.comparable_rows import rest_friction
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset
from identification.selection import Split
from tests.diagnosis import two_link
from tests.diagnosis.two_link import Day, recorded

ROWS, JOINTS = 1500, 2


def _side(y: np.ndarray) -> Dataset:
    run = SimpleNamespace(t=np.arange(ROWS) / 100.0, alike=2.5)
    block = np.tile((run.t // 1.0).astype(np.intp), JOINTS)
    return Dataset(cast(Any, (run,)), cast(Any, (run,)), y, block, ROWS)


def _chances(size: float, left: float, seed: int) -> np.ndarray:
    """Of a column that is the model's own direction but for a tenth, in 60 draws of noise and of the model's errors."""
    rng, found = np.random.default_rng(seed), []
    length = JOINTS * ROWS
    for _ in range(60):
        directions = Split(0.2 * rng.normal(size=(length, 3)), 0.2 * rng.normal(size=(length, 3)))
        x = directions.map(lambda one: one[:, :1] + 0.02 * rng.normal(size=(length, 1)))
        u = rng.normal(size=3)
        noisy = (one @ u + size * own[:, 0] + rng.normal(size=length) for one, own in zip(directions, x))
        known = ModelUncertainty(directions, np.full(JOINTS, left))
        pair = x.map(lambda own: Columns(own, slice(0, length)))
        fit, held_out = map(_side, noisy)
        found.append(Significance(Split(fit, held_out), [], known).chance(pair))
    return np.array(found)


@pytest.mark.parametrize(
    ("axis", "library", "uncertainty", "by_selection", "by_exact_model"),
    [
        (None, ["a column"], None, True, True),
        (None, ["a column"], "known", True, False),
        (None, [], None, False, False),
        ("axis", ["a column"], None, False, False),
    ],
)
def test_a_model_that_states_its_uncertainty_is_not_taken_for_exact(
    axis: Any, library: Any, uncertainty: Any, by_selection: bool, by_exact_model: bool
) -> None:
    searched = object.__new__(CurrentDiagnosis)
    searched.__dict__.update(axis=axis, library=library, arm=SimpleNamespace(uncertainty=uncertainty))
    assert (searched.by_selection, searched.by_exact_model) == (by_selection, by_exact_model)


@pytest.mark.parametrize("exact", [True, False])
def test_what_only_an_exact_model_shows_is_not_looked_for_with_another(
    exact: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = list[str]()

    def noted(what: str) -> Any:
        return lambda *_, **__: asked.append(what) or ()

    for name, what in (("chattering_gaps", "teeth"), ("lost_in_loop", "lost rows"), ("_in_loop", "friction in loop")):
        monkeypatch.setattr(outside_selection, name, noted(what))
    monkeypatch.setattr(outside_selection, "friction_causes", lambda *_: Friction([], []))
    monkeypatch.setattr(outside_selection, "extend", lambda arm, causes: arm)
    monkeypatch.setattr(outside_selection, "with_smoothing_velocities", lambda arm, recordings: arm)
    currents: Any = SimpleNamespace(
        by_selection=True,
        by_exact_model=exact,
        axis=None,
        base=None,
        library=(),
        causes=[],
        state=SimpleNamespace(runs=Split((), ()), terms=[]),
        selection=SimpleNamespace(unexplained=SimpleNamespace(structures=[])),
        residuals=SimpleNamespace(samples=[], losses=[]),
    )
    recordings: Any = Split([], [])
    assert outside_selection.gaps(currents, frozenset()) == ()
    assert outside_selection.rows_lost_in_loop(currents, recordings) is None
    assert outside_selection.friction_near_rest(currents, recordings, frozenset()) == Friction([], [])
    assert asked == (["teeth", "lost rows", "friction in loop"] if exact else [])
    assert exact or find_causes._with_rise_at_rest(currents) is currents


def test_the_models_own_errors_are_significant_no_more_often_than_chance_has_it() -> None:
    chances = _chances(0.0, 0.0, 1)
    assert np.mean(chances < 0.1) < 0.15 and chances.min() > 1e-3
    assert 0.3 < np.median(chances) < 0.85


def test_what_is_far_beyond_them_is_significant_whatever_the_model_says() -> None:
    assert _chances(12.0, 0.0, 2).max() < 1e-6


def test_what_the_model_left_over_hides_as_much() -> None:
    assert np.median(_chances(6.0, 3.0, 3)) > 10.0 * np.median(_chances(6.0, 0.0, 3))


def test_what_is_beyond_both_is_significant_though_the_model_may_err_nearly_like_it() -> None:
    """What distinguishes the two is small, and what the model left over is no white noise by which to weigh it."""
    assert _chances(20.0, 3.0, 5).max() < 1e-6
    assert _chances(0.0, 3.0, 5).min() > 0.01


def test_what_the_model_left_over_hides_of_a_ripple_what_ripples_explained_of_it() -> None:
    rng = np.random.default_rng(4)
    length = JOINTS * ROWS
    x = Split(*(np.concatenate([rng.normal(size=(ROWS, 1)), np.zeros((ROWS, 1))]) for _ in range(2)))
    pair, nothing = x.map(lambda own: Columns(own, slice(0, length))), np.zeros((length, 0))
    fit, held_out = (_side(own[:, 0] + 2.0 * rng.normal(size=length)) for own in x)
    left = ModelUncertainty(Split(nothing, nothing), np.full(JOINTS, 3.0))
    any_effect = Significance(Split(fit, held_out), [], left).chance(pair)
    for shares, candidate, hides in [
        ((0.02, 0.5), _ripple(1), False),
        ((0.02, 0.5), None, True),
        ((0.02, 0.5), Candidate("coulomb_friction", 1), True),
        ((0.5, 0.02), _ripple(1), True),
        ((0.5, 0.02), _ripple(2), True),
    ]:
        known = replace(left, rippled=np.array(shares))
        chance = Significance(Split(fit, held_out), [], known).chance(pair, candidate)
        assert chance == pytest.approx(any_effect) if hides else chance < 0.01 * any_effect
    # of an effect, what it explained of it, where that is stated
    known = replace(left, aliased={"joint1.coulomb_friction": 0.02, "time_skew": 0.4})
    significance = Significance(Split(fit, held_out), [], known)
    for other in (Candidate("coulomb_friction", 2), Candidate("coulomb_friction", 1, terms=("change",))):
        assert significance.chance(pair, other) == pytest.approx(any_effect)
    assert significance.chance(pair, Candidate("coulomb_friction", 1)) < 0.01 * any_effect
    assert significance.chance(pair, Candidate("time_skew", None)) > 2.0 * any_effect


def _ripple(joint: int) -> Candidate:
    return Candidate("gear_ripple", joint, (("order", 7.5),))


ORDERS = 60


def _strongest(size: float, seed: int) -> float:
    """Chance of the strongest of all waves in what a model leaves on another day.

    There, one wave is larger by so many times the strongest that the model left when it was identified.
    """
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, 2.0 * np.pi, ROWS)
    waves = [np.stack([np.cos(k * angle), np.sin(k * angle)], axis=1) for k in range(1, ORDERS + 1)]

    def left() -> np.ndarray:
        return np.asarray(np.hstack(waves) @ (0.4 * rng.normal(size=2 * ORDERS)))

    def gains(*of: np.ndarray) -> np.ndarray:
        return np.array([np.sum(sum(wave.T @ y for y in of) ** 2) for wave in waves]) / ROWS

    before = left(), left()
    share = float(gains(*before).max() / sum(one @ one for one in before))
    more = size * np.sqrt(gains(*before).max() / ROWS) * waves[16][:, 0]
    day = left() + more, left() + more
    squares, count = np.mean(np.square(before)), np.full(JOINTS, ORDERS)
    nothing = np.zeros((JOINTS * ROWS, 0))
    known = ModelUncertainty(
        Split(nothing, nothing),
        np.array([squares, 0.0]),
        rippled=of_strongest(np.full(JOINTS, share), count),
        orders=count,
    )
    y = (np.concatenate([one, np.zeros(ROWS)]) + rng.normal(size=JOINTS * ROWS) for one in day)
    pair = Columns(waves[int(np.argmax(gains(*day)))], slice(0, ROWS))
    fit, held_out = map(_side, y)
    return Significance(Split(fit, held_out), [], known).chance(Split(pair, pair), _ripple(1))


def test_the_strongest_ripple_of_another_day_is_one_of_as_many_and_one_of_four_times_its_size_is_not() -> None:
    assert min(_strongest(0.0, seed) for seed in range(20)) > 1e-3
    assert max(_strongest(4.0, seed) for seed in range(20)) < 1e-3


def test_either_side_is_allowed_what_the_model_is_known_to_there() -> None:
    """Both sides have as many rows: the error of the model is felt at joint 1 in one, at joint 2 in the other."""
    felt = np.zeros((2, JOINTS * ROWS, 1))
    felt[0, :ROWS], felt[1, ROWS:] = np.sqrt(3.0), np.sqrt(8.0)
    noise = np.zeros(JOINTS * ROWS)
    known = ModelUncertainty(Split(felt[0], felt[1]), np.zeros(JOINTS))
    allowed = Significance(Split(_side(noise), _side(noise)), [], known).allowed
    assert allowed.fit == pytest.approx([2.0, 1.0])
    assert allowed.held_out == pytest.approx([1.0, 3.0])


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return two_link.model(root)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    """Recordings of the arm as it is."""
    folder = tmp_path_factory.mktemp("healthy")
    return [recorded(folder / f"{name}.mcap", seed, Day()) for seed, name in enumerate("AB")]


def _off(arm: Arm, std: float) -> Arm:
    """The model with too much friction at joint 1, known to ``std`` N m."""
    level = parameter(arm, "joint1.coulomb")
    known = uncertainty_of("model_uncertainty.json", ("joint1.coulomb",), np.array([[std**2]]))
    return replace(with_parameters(arm, {"joint1.coulomb": level + 0.5}), uncertainty=known)


def test_a_model_that_is_off_by_what_it_says_names_nothing(arm: Arm, runs: list[Recording]) -> None:
    exact = armscope.diagnose(runs[0], replace(_off(arm, 0.4), uncertainty=None), held_out=runs[1])
    assert [(cause.effect, cause.joint) for cause in exact.causes] == [("coulomb_friction", 1)]
    assert exact.details.known_to is None and exact.causes[0].deviations is None
    known = armscope.diagnose(runs[0], _off(arm, 0.4), held_out=runs[1])
    assert known.verdict == "consistent" and "Consistent, as far as the model is known: " in str(known)
    known_to = known.details.known_to
    assert known_to is not None and known_to[0] > 2.0 and known_to[1] == pytest.approx(1.0)


def test_what_is_beyond_it_is_named_with_what_remains_of_its_significance(
    arm: Arm, runs: list[Recording], tmp_path: Path
) -> None:
    known = armscope.diagnose(runs[0], _off(arm, 0.05), held_out=runs[1])
    (cause,) = known.causes
    assert (cause.effect, cause.joint) == ("coulomb_friction", 1)
    (level,) = cause.parameters
    assert abs(level.value + 0.5) < 2 * level.std and level.std > 0.05
    assert cause.deviations is not None
    exact, remains = cause.deviations
    assert 4.0 < remains < 12.0 and remains < exact
    (row,) = known.to_json()["causes"]
    assert row["deviations"] == {"exact": exact, "known": remains}
    assert f"{remains:.1f} standard deviations from zero" in str(known)
    write_model(tmp_path / "model.toml", known.extended)
    extended = armscope.read_model(tmp_path / "model.toml")
    assert extended.effects and extended.uncertainty == known.extended.uncertainty


def test_a_day_that_is_a_little_warmer_changes_nothing(arm: Arm, tmp_path: Path) -> None:
    """Viscous friction 4 % and Coulomb friction 1 % less, of a model that states a small uncertainty; half is named."""
    names = tuple(f"joint{joint}.{kind}" for joint in (1, 2) for kind in ("coulomb", "viscous"))
    covariance = np.diag([(0.001 * parameter(arm, name)) ** 2 for name in names])
    known = replace(arm, uncertainty=uncertainty_of("model_uncertainty.json", names, covariance))

    def diagnosed(model: Arm, day: Day) -> armscope.Diagnosis:
        first, second = (recorded(tmp_path / f"{seed}.mcap", seed, day) for seed in (11, 12))
        return armscope.diagnose(first, model, held_out=second)

    warmer = Day(coulomb=tuple(-0.01 * two_link.COULOMB), viscous=tuple(-0.04 * two_link.VISCOUS))
    assert {cause.effect for cause in diagnosed(arm, warmer).causes} <= {"coulomb_friction", "viscous_friction"}
    assert diagnosed(arm, warmer).causes
    assert diagnosed(known, warmer).verdict == "consistent"
    less = diagnosed(known, replace(warmer, viscous=(-5.0, 0.0)))
    assert [(cause.effect, cause.joint) for cause in less.causes] == [("viscous_friction", 1)]


def test_friction_beyond_the_speeds_of_the_identification_is_known_roughly(arm: Arm, runs: list[Recording]) -> None:
    """A model that is right up to 0.3 rad/s, the end of its curve, and a fifth too steep beyond."""
    names = ("joint1.coulomb", "joint1.viscous")
    covariance = np.diag([(0.001 * parameter(arm, name)) ** 2 for name in names])
    slope = parameter(arm, "joint1.viscous")
    steeper = with_parameters(arm, {"joint1.viscous": 1.2 * slope})

    right = (0.0, *(-0.2 * slope * speed for speed in (0.3, 0.3)))
    curve = FrictionCurve((0.0, 0.3, 0.31), right, right)
    joints = (replace(steeper.joints[0], friction_curve=curve), *steeper.joints[1:])
    known = replace(steeper, joints=joints, uncertainty=uncertainty_of("u.json", names, covariance))
    result = armscope.diagnose(runs[0], known, held_out=runs[1])
    assert result.verdict == "consistent"
    (first, _) = result.to_json()["joints"]
    assert 2.0 < first["noise_ratio"]["held_out"] < first["known_to"]


def test_friction_near_rest_is_uncertain_by_the_coulomb_friction_at_least(arm: Arm) -> None:
    """A curve may fall to nothing at its lowest speed, which few rows show: a row near standstill is not exact then."""
    straight = rest_friction(arm)
    level = arm.joints[0].ratio * arm.joints[0].coulomb[0]
    falling = FrictionCurve((0.01, 0.1, 1.0), (-level, 0.0, 0.0), (-level, 0.0, 0.0))
    curved = replace(arm, joints=(replace(arm.joints[0], friction_curve=falling), *arm.joints[1:]))
    np.testing.assert_allclose(rest_friction(curved), straight)
