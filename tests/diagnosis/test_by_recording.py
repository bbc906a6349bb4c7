"""A cause that is not the same in all recordings is told per recording, and makes no other name.

Neither the arm's dynamics nor what differs is our effect code (``tests.diagnosis.two_link``).
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import armscope
from arm_model import Arm, EffectTerm
from diagnosis.cause import Cause, Estimate
from diagnosis.measurements.near_rest.friction import Friction
from diagnosis.per_recording import candidates
from diagnosis.per_recording import search as search_of_values
from diagnosis.per_recording import values as values_of_recordings
from diagnosis.per_recording.search import _all_exist
from diagnosis.remainder.against_noise import runs_of
from diagnosis.residual.run import with_free
from diagnosis.selection.candidate import Candidate
from identification.selection import Split
from tests.diagnosis import two_link
from tests.diagnosis.two_link import HUMP, Day, recorded


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return two_link.model(root)


def _diagnosed(arm: Arm, folder: Path, *days: Day) -> armscope.Diagnosis:
    runs = [recorded(folder / f"{name}.mcap", seed, day) for seed, (name, day) in enumerate(zip("AB", days))]
    return armscope.diagnose(runs[0], arm, held_out=runs[1])


def test_the_arm_is_the_model(arm: Arm, tmp_path: Path) -> None:
    assert _diagnosed(arm, tmp_path, Day(), Day()).verdict == "consistent"


def test_a_load_mounted_differently_is_one_payload_with_two_sizes(arm: Arm, tmp_path: Path) -> None:
    loads = {"A.mcap": (3.0, 0.05, 0.0), "B.mcap": (2.8, 0.02, 0.03)}
    result = _diagnosed(arm, tmp_path, *(Day(load=load) for load in loads.values()))
    (cause,) = result.causes
    assert (result.verdict, cause.effect) == ("explained", "payload")
    assert set(cause.of_recordings) == set(loads)
    for name, (mass, x, _) in loads.items():
        found = {p.name: p for p in cause.of_recordings[name]}
        assert abs(found["mass"].value - mass) < 2 * found["mass"].std < 0.5
        assert abs(found["x"].value - x) < 2 * found["x"].std
    assert cause.after < 0.1 * cause.before
    assert "kg in A.mcap, 2.8" in str(result) and "mounted differently" in str(result)
    (row,) = result.to_json()["causes"]
    assert [one["file"] for one in row["recordings"]] == ["A.mcap", "B.mcap"]
    assert not result.extended.effects  # no load is the arm's


def test_friction_near_rest_keeps_its_name_beside_values_per_recording(
    arm: Arm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was in the model then, but no longer among the causes."""
    friction = Cause(
        effect="stribeck_friction",
        joint=1,
        parameters=[Estimate("breakaway", 1e-3, 1e-4, "N m"), Estimate("stribeck_velocity", HUMP, 0.01, "rad/s")],
        confidence=0.9,
        before=0.02,
        after=0.01,
        group=(("stribeck_friction", 1),),
        evidence="",
        felt_at=1,
        unit="A",
    )
    monkeypatch.setattr("diagnosis.find_causes.friction_near_rest", lambda *_: Friction([friction], []))
    result = _diagnosed(arm, tmp_path, Day(load=(3.0, 0.05, 0.0)), Day(load=(2.8, 0.02, 0.03)))
    assert {cause.key for cause in result.causes} == {friction.key, ("payload", None)}
    assert [term.name for term in result.extended.effects] == ["stribeck_friction"]


def test_the_same_load_in_both_is_one_value(arm: Arm, tmp_path: Path) -> None:
    (cause,) = _diagnosed(arm, tmp_path, *[Day(load=(3.0, 0.05, 0.0))] * 2).causes
    assert cause.effect == "payload" and not cause.of_recordings
    assert abs(cause.parameters[0].value - 3.0) < 2 * cause.parameters[0].std


@pytest.mark.parametrize(
    ("effect", "joint", "first", "second", "sizes"),
    [
        pytest.param(
            *("current_gain", 2, Day(gain=(1.0, 1.1)), Day(gain=(1.0, 0.95)), (0.1, -0.05)), marks=pytest.mark.slow
        ),
        pytest.param(
            *("current_offset", 1, Day(offset=(0.1, 0.0)), Day(offset=(-0.05, 0.0)), (0.1, -0.05)),
            marks=pytest.mark.slow,
        ),
        ("viscous_friction", 1, Day(viscous=(2.0, 0.0)), Day(viscous=(0.7, 0.0)), (2.0, 0.7)),
        pytest.param(
            *("viscous_friction", 2, Day(viscous=(0.0, 3.0)), Day(viscous=(0.0, -1.0)), (3.0, -1.0)),
            marks=pytest.mark.slow,
        ),
        ("coulomb_friction", 1, Day(coulomb=(2.0, 0.0)), Day(coulomb=(0.7, 0.0)), (2.0, 0.7)),
    ],
)
def test_what_was_set_or_ran_differently_has_a_value_per_recording(
    arm: Arm, tmp_path: Path, effect: str, joint: int, first: Day, second: Day, sizes: tuple[float, float]
) -> None:
    result = _diagnosed(arm, tmp_path, first, second)
    (cause,) = result.causes
    assert (result.verdict, cause.effect, cause.joint) == ("explained", effect, joint)
    for (own, *_), size in zip(cause.of_recordings.values(), sizes, strict=True):
        assert abs(own.value - size) < 2 * own.std
    assert "in A.mcap, " in str(result) and "in B.mcap: " in str(result)


def test_a_parameter_that_serves_all_recordings_has_the_std_of_one(arm: Arm, tmp_path: Path) -> None:
    """Its values do not scatter: their standard deviation was that of rounding, 1e-17."""
    (cause,) = _diagnosed(arm, tmp_path, Day(hump=(10.0, 0.0)), Day(hump=(6.0, 0.0))).causes
    assert cause.effect == "stribeck_friction" and len(cause.of_recordings) == 2
    for found in (cause.parameters, *cause.of_recordings.values()):
        (speed,) = (p for p in found if p.name == "stribeck_velocity")
        assert 0.01 * HUMP < speed.std < 0.3 * HUMP and abs(speed.value - HUMP) < 2 * speed.std


def test_a_recording_in_which_a_joint_stands_contradicts_no_value_of_its_friction(arm: Arm, tmp_path: Path) -> None:
    """A single move of the other joint: the friction of the first does not follow its speed."""
    days = [Day(coulomb=(0.5, 0.0)), Day(slow=1e-3, held=0.0), Day(coulomb=(0.5, 0.0))]
    *fit, held_out = (recorded(tmp_path / f"{seed}.mcap", seed, day) for seed, day in enumerate(days))
    (cause,) = armscope.diagnose(fit, arm, held_out=held_out).causes
    (friction,) = cause.parameters
    assert cause.key == ("coulomb_friction", 1) and not cause.of_recordings
    assert abs(friction.value - 0.5) < 2 * friction.std < 0.1


@pytest.mark.parametrize("slow", [0.05, 0.2])
def test_friction_that_sticks_contradicts_no_value_of_a_slow_recording(arm: Arm, tmp_path: Path, slow: float) -> None:
    """The model's turns round over 0.01 rad/s: at a few times that speed it lacks more than the noise, in every row."""
    days = [Day(positive=(0.5, 0.0), width=1e-6, slow=share) for share in (1.0, slow, 1.0)]
    *fit, held_out = (recorded(tmp_path / f"{seed}.mcap", seed, day) for seed, day in enumerate(days))
    (cause,) = armscope.diagnose(fit, arm, held_out=held_out).causes
    assert cause.key == ("friction_asymmetry", 1) and not cause.of_recordings
    truth = {"positive": 0.5, "negative": 0.0, "viscous_positive": 0.0, "viscous_negative": 0.0}
    assert all(abs(found.value - truth[found.name]) < 2 * found.std < 0.1 for found in cause.parameters)


@pytest.mark.slow
def test_beside_a_load_mounted_differently_a_cause_of_the_arm_keeps_its_name(arm: Arm, tmp_path: Path) -> None:
    rubs = (0.0, 1.5)
    days = [Day(load=load, coulomb=rubs) for load in ((3.0, 0.05, 0.0), (2.8, 0.02, 0.03))]
    result = _diagnosed(arm, tmp_path, *days)
    found = {(cause.effect, cause.joint): cause for cause in result.causes}
    assert set(found) == {("payload", None), ("coulomb_friction", 2)}
    (friction,) = found["coulomb_friction", 2].parameters
    assert abs(friction.value - rubs[1]) < 2 * friction.std
    assert [own[0].value for own in found["payload", None].of_recordings.values()] == pytest.approx([3.0, 2.8], rel=0.1)
    assert [term.name for term in result.extended.effects] == ["coulomb_friction"]


LOAD = (3.0, 0.05, 0.0)


@pytest.mark.parametrize(
    ("first", "second", "own", "of_arm"),
    [
        (
            *(Day(load=LOAD, viscous=(2.0, 0.0)), Day(load=LOAD, viscous=(0.7, 0.0))),
            *({("viscous_friction", 1): (2.0, 0.7)}, {("payload", None): 3.0}),
        ),
        pytest.param(
            *(Day(viscous=(2.0, 3.0)), Day(viscous=(0.7, -1.0))),
            *({("viscous_friction", 1): (2.0, 0.7), ("viscous_friction", 2): (3.0, -1.0)}, {}),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            *(Day(viscous=(2.0, 0.0), coulomb=(1.5, 0.0)), Day(viscous=(0.7, 0.0), coulomb=(0.5, 0.0))),
            *({("viscous_friction", 1): (2.0, 0.7), ("coulomb_friction", 1): (1.5, 0.5)}, {}),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            *(Day(load=LOAD, viscous=(0.0, 3.0)), Day(load=(2.8, 0.02, 0.03), viscous=(0.0, -1.0))),
            *({("payload", None): (3.0, 2.8), ("viscous_friction", 2): (3.0, -1.0)}, {}),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_several_causes_have_values_per_recording_beside_those_of_the_arm(
    arm: Arm,
    tmp_path: Path,
    first: Day,
    second: Day,
    own: dict[tuple[str, int | None], tuple[float, float]],
    of_arm: dict[tuple[str, int | None], float],
) -> None:
    result = _diagnosed(arm, tmp_path, first, second)
    found = {(cause.effect, cause.joint): cause for cause in result.causes}
    assert result.verdict == "explained" and set(found) == {*own, *of_arm}
    for key, sizes in own.items():
        for (value, *_), size in zip(found[key].of_recordings.values(), sizes, strict=True):
            assert abs(value.value - size) < 2 * value.std < 0.5
    for key, size in of_arm.items():
        assert not found[key].of_recordings
        assert abs(found[key].parameters[0].value - size) < 2 * found[key].parameters[0].std


def test_beside_columns_that_are_free_in_a_recording_others_keep_their_coefficients(arm: Arm, tmp_path: Path) -> None:
    """Frisch and Waugh: regression of what is left of both gives the coefficients of the regression on all."""
    sample = recorded(tmp_path / "a.mcap", 3, Day(viscous=(1.0, 0.0), coulomb=(0.5, 0.3)))
    (run,) = runs_of(arm, [sample], [])
    rng = np.random.default_rng(0)
    free = np.stack([run.v, np.tanh(run.q)], axis=-1) * run.noise[:, None]
    other = np.stack([np.sign(run.v), rng.normal(size=run.v.shape)], axis=-1)
    beside = with_free(run, free)
    together = run.whiten(np.concatenate([other, free], axis=-1)).reshape(-1, 4)
    expected = np.linalg.lstsq(together, run.whitened.ravel(), rcond=None)[0][:2]
    found = np.linalg.lstsq(beside.whiten(other).reshape(-1, 2), beside.whitened.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    assert not beside.whiten(free @ rng.normal(size=(2, 3))).any()
    assert with_free(beside, None).whitened == pytest.approx(run.whitened)


@pytest.mark.parametrize(("second", "exists"), [(2.0, True), (-90.0, False)])
def test_values_of_one_recording_that_no_arm_has_end_the_search(arm: Arm, second: float, exists: bool) -> None:
    """The random arm 30357 was refused: "payload makes the arm impossible"."""
    several = [EffectTerm("payload", None, {"mass": m, "x": 0.1, "y": 0.0, "z": 0.0}) for m in (1.0, second)]
    state, own = SimpleNamespace(model=SimpleNamespace(arm=arm)), SimpleNamespace(terms=several)
    assert _all_exist([own], state) == exists  # type: ignore[list-item, arg-type]


@pytest.mark.parametrize(
    ("gains", "ranked"),
    [
        ({"payload": 100.0, "viscous_friction": 99.0, "coulomb_friction": 90.0}, ["viscous_friction", "payload"]),
        ({"payload": 100.0, "viscous_friction": 97.0, "coulomb_friction": 98.5}, ["coulomb_friction", "payload"]),
        ({"payload": 100.0, "viscous_friction": 90.0, "coulomb_friction": 97.0}, ["payload", "coulomb_friction"]),
        ({"payload": 9.0, "viscous_friction": 8.0, "coulomb_friction": 11.0}, ["coulomb_friction"]),
        ({"payload": 50.0, "viscous_friction": 40.0, "current_gain": 200.0}, ["payload", "viscous_friction"]),
    ],
)
def test_of_effects_that_gain_equally_by_own_values_the_one_of_fewest_coefficients_comes_first(
    gains: dict[str, float], ranked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 100 rows: less than 10 is nothing. A current gain has 199 of its 200 by one value for all recordings."""
    library = [Candidate(effect, None if effect == "payload" else 1) for effect in gains]
    data = Split(SimpleNamespace(rows=50), SimpleNamespace(rows=50))
    model = SimpleNamespace(data=data, library=library, excluded=set(), columns=lambda c: c)

    def fitted(several: list[Candidate], *_: object) -> list[SimpleNamespace]:
        (c,) = several
        alone = SimpleNamespace(values=np.zeros(4 if c.effect == "payload" else 1))
        return [SimpleNamespace(candidate=c, gains=np.array([gains[c.effect]]), alone=[alone])]

    monkeypatch.setattr(candidates, "fitted_values", fitted)
    monkeypatch.setattr(candidates, "residuals_with", lambda *_: [])
    monkeypatch.setattr(candidates, "exists_in_all", lambda *_: True)
    monkeypatch.setattr(candidates, "_common_gain", lambda c, *_: 199.0 if c.effect == "current_gain" else 0.0)
    found = candidates.promising(cast(Any, SimpleNamespace(model=model)))
    assert [c.effect for c in found] == ranked


@pytest.mark.parametrize(
    ("energies", "searched"),
    [
        ([80.0, 60.0, 40.0], 3),  # after three, no more get such values
        ([95.0], 1),  # the first brought too little
        ([80.0, 75.0], 2),
    ],
)
def test_another_cause_gets_values_per_recording_while_each_takes_a_tenth(
    energies: list[float], searched: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    more = iter([Candidate("coulomb_friction", joint) for joint in (2, 3, 4)])
    monkeypatch.setattr(search_of_values, "values_per_recording", lambda *_: [])
    monkeypatch.setattr(search_of_values, "contradicted", lambda state: next(more))
    seen = list[float]()

    def search(runs: object, taken: object) -> Any:
        seen.append(energies[len(seen)])
        state = SimpleNamespace(energy=[seen[-1]], terms=[])
        return SimpleNamespace(selection=SimpleNamespace(state=state, unexplained=SimpleNamespace(structures=[])))

    first, state = Candidate("coulomb_friction", 1), cast(Any, SimpleNamespace(energy=[100.0], model=None))
    assert search_of_values._grown(first, state, [], search) is None
    assert len(seen) == searched


def test_values_of_a_recording_are_those_of_the_exact_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a law v + 0.1 v^2, a residual of 1.1 is a value of 1: 1.1 by the first order, 1.004 after two corrections."""
    rows, x = np.ones(50), np.ones((50, 1))
    monkeypatch.setattr(values_of_recordings, "_term", lambda c, values: values)
    monkeypatch.setattr(values_of_recordings, "with_own", lambda run, terms: float(terms[-1][0]))
    monkeypatch.setattr(values_of_recordings, "whitened_of", lambda v: (1.1 - v - 0.1 * v**2) * rows)
    several: Any = [(Candidate("coulomb_friction", 1), slice(0, 1))]
    y = values_of_recordings._corrected(cast(Any, None), x, 1.1 * rows, several, ())
    assert np.ptp(y) < 1e-12 and abs(y[0] - 1.0) < 0.005
