"""Edges that one group of channels lost, hidden in runs of an independent plant.

Found where they are, and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from arm_model.description import EffectTerm
from arm_model.model_file import read_model
from diagnosis.residual.expected_current import predicted_current
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import KnownNoise
from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows.lag_change import Change, _change, change_of_lag
from diagnosis.screening.lost_rows.lag_path import Step, _changes, in_order, lag_steps
from diagnosis.screening.lost_rows.losses import DroppedTriggers, event_of, realigned_rows
from diagnosis.screening.lost_rows.lost_triggers import (
    SIGNIFICANT_STDS,
    _aligned,
    _long,
    _short,
    dropped_triggers,
    energy,
)
from diagnosis.screening.residuals import Residuals, confirmed, realigned, with_aligned_currents
from tests.blind.hide import Hidden, hide_in_signals
from tests.blind.laboratory import Laboratory
from tests.blind.motions import fourier
from tests.blind.record import Truth, recorded, truth
from tests.diagnosis import two_link
from tests.diagnosis.two_link import DRIVE, Day, motion, torque

pytest.importorskip("numba", reason="the plant of the hidden-effect tests is compiled by numba")

LABORATORY = Laboratory("singles")
PERIOD = 1e-3


TRUE: dict[str, Truth] = {}
"""What an arm does with all that is hidden but lost edges, which leave its motion as it was; simulated once."""


def _truth(hidden: tuple[Hidden, ...], seed: int) -> Truth:
    edges = tuple(one for one in hidden if one.effect == "dropped_trigger")
    others = tuple(one for one in hidden if one not in edges)
    key = f"{others}, {seed}"
    if key not in TRUE:
        TRUE[key] = truth(fourier("run", seed, 0.12, 0.9, 10.0), others, LABORATORY)
    return replace(TRUE[key], signals=hide_in_signals(TRUE[key].signals, edges))


def _residuals(root: Path, *hidden: Hidden, seed: int = 3) -> Residuals:
    what = _truth(hidden, seed)
    rows = recorded(what, LABORATORY, seed)
    samples = what.signals.t, rows.q, rows.i
    run = residual_run("run", read_model(root / "config" / "models" / "puma560.toml"), *samples)
    return Residuals([], [run], [samples], [PERIOD], [KnownNoise()], [()], [()])


def _seen(root: Path, *hidden: Hidden, seed: int = 3) -> Run:
    return _residuals(root, *hidden, seed=seed).runs[0]


def _found(*runs: Run) -> list[DroppedTriggers]:
    return dropped_triggers(runs, [PERIOD] * len(runs))


@pytest.mark.parametrize(("row", "count"), [(4200, 2), (7000, 5), (3000, 2)])
def test_lost_edges_are_found_and_put_back(root: Path, row: int, count: int) -> None:
    run = _seen(root, Hidden("dropped_trigger", None, {"row": row, "count": count}))
    (loss,) = _found(run)
    assert loss.count == count
    assert abs(loss.row - row) < 3 * loss.row_std
    assert loss.row_std < 1000
    event = event_of([loss], [run])
    assert [one.row_std for one in event.lost_rows] == [loss.row_std]
    assert event.effect == "dropped_trigger"
    assert {p.name: p.value for p in event.parameters} == {"row": loss.row, "count": count, "period": PERIOD}


@dataclass(frozen=True)
class _Currents:
    """Of a recording: (m, n) A."""

    i: np.ndarray


@pytest.mark.parametrize("count", [0, 5])
def test_closed_loops_are_judged_by_currents_in_their_places(root: Path, count: int) -> None:
    """A recording whose currents came 6 ms early from its middle on was denied by the transients at its setpoints."""
    edges = (Hidden("dropped_trigger", None, {"row": 7000, "count": count}),) if count else ()
    found, healthy = realigned(_residuals(root, *edges), []), _residuals(root).samples[0][2]
    as_recorded = _Currents(_residuals(root, *edges).samples[0][2])
    (aligned,) = with_aligned_currents(cast(Any, [as_recorded]), found)
    off, left = (np.std((one.i - healthy)[8000:-100]) for one in (as_recorded, aligned))
    assert left < 0.1 * off if count else aligned is cast(Any, as_recorded)


@pytest.mark.parametrize("count", [27, 140, 1800, -60])
def test_gaps_of_any_length_are_found(root: Path, count: int) -> None:
    run = _seen(root, Hidden("dropped_trigger", None, {"row": 4200, "count": count}))
    (loss,) = _found(run)
    assert abs(loss.count - count) <= max(1.0, 3 * loss.count_std)
    assert abs(loss.row - 4200) < 3 * loss.row_std + 20
    assert loss.row_std < 1000


def test_a_long_change_is_lost_edges_though_a_fraction_of_a_row_is_not_known(root: Path) -> None:
    """As refined where another error hides it from the path of lags: at a high rate its std may be half a row."""
    run = _seen(root, Hidden("dropped_trigger", None, {"row": 4200, "count": 27}))
    (loss,) = _short(0, run, Change(4.2, -26.6e-3, 0.5e-3), PERIOD)
    assert loss.count == 27 and loss.count_std >= 0.5
    assert abs(loss.row - 4200) < 3 * loss.row_std + 20 and loss.row_std < 1000
    assert _short(0, run, Change(4.2, -5e-3, 0.5e-3), PERIOD) == []


@pytest.mark.parametrize(("more", "count", "std"), [(3e-3, 27, 0.2), (20e-3, 30, 5.0)])
def test_no_refinement_leaves_what_the_path_of_lags_resolves(root: Path, more: float, count: int, std: float) -> None:
    """Beside a ripple the first order of a lag was off by 20 ms and known to 3: eight rows at 250 Hz became 13.

    The path, in steps of 10 ms, shows 30 rows of 27.
    """
    run = _seen(root, Hidden("dropped_trigger", None, {"row": 4200, "count": 27}))
    (steps,) = lag_steps(run)
    (loss,) = _long(0, (run, _aligned(run, steps)[0]), (steps, 0), Change(4.2, more, 0.2e-3), PERIOD)
    assert loss.count == count and loss.count_std == pytest.approx(std, rel=0.01)


def test_several_gaps_of_one_recording_are_found(root: Path) -> None:
    """The second is counted among the recorded currents; it stands among the angles."""
    lost = [(2500, 30), (5000, 60), (8200, 4)]
    run = _seen(root, *(Hidden("dropped_trigger", None, {"row": row, "count": count}) for row, count in lost[::-1]))
    found = _found(run)
    assert [loss.count for loss in found] == [30, 60, 4]
    for loss, (row, _) in zip(found, lost):
        assert abs(loss.row - row) < 3 * loss.row_std + 50


def test_a_lag_that_changes_by_one_row_of_the_comparison_divides_no_part() -> None:
    """Of 40, 5 and 12 rows at 400 Hz, the 5 made the part before the 12 too short to judge; the 40 were told as 50."""
    path = np.repeat([0, 10, 11, 14], [10, 13, 3, 20])
    assert _changes(path) == [(0, 9, 10, 26), (10, 25, 26, 46)]


def test_a_lag_that_is_always_there_is_not_lost_edges(root: Path) -> None:
    assert _found(_seen(root, Hidden("time_skew", None, {"delay": 3e-3}))) == []


def test_lost_edges_beside_a_lag(root: Path) -> None:
    skew = Hidden("time_skew", None, {"delay": 2e-3})
    (loss,) = _found(_seen(root, skew, Hidden("dropped_trigger", None, {"row": 5000, "count": 3})))
    assert loss.count == 3


def test_lost_edges_are_found_behind_an_effect_that_hides_them(root: Path) -> None:
    loss = {"row": 4975, "count": 2}
    payload = {"mass": 0.6, "x": 0.015, "y": 0.0, "z": 0.05}
    residuals = _residuals(root, Hidden("payload", None, payload), Hidden("dropped_trigger", None, loss))
    assert realigned(residuals, []) is residuals
    terms = [EffectTerm("payload", None, payload)]
    found = realigned(residuals, terms)
    (event,) = found.events
    values = {p.name: p for p in event.parameters}
    assert values["count"].value == 2
    assert abs(values["row"].value - 4975) < 3 * values["row"].std
    # and the other way round: without the payload nothing shows, and the recording stays as it was
    assert confirmed(found, terms) is found and confirmed(found, []) is residuals


def test_steps_that_make_the_residual_larger_are_no_lost_rows(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a search proposes for the lag is judged by what it leaves, at all joints together."""
    residuals = _residuals(root)
    made_up = [DroppedTriggers(0, 4000.0, 10.0, 300, 1.0, PERIOD)]
    monkeypatch.setattr("diagnosis.screening.residuals.dropped_triggers", lambda runs, periods: made_up)
    assert realigned(residuals, []) is residuals


def test_a_lag_that_another_error_chooses_hides_no_short_loss(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A joint that breaks away by another law fits its first half second best with the currents of seconds later."""
    run = _seen(root, Hidden("dropped_trigger", None, {"row": 7000, "count": 5}))
    where = "diagnosis.screening.lost_rows.lost_triggers.lag_steps"
    for step in (Step(0.46, 3.53), Step(1.21, 2.13)):
        monkeypatch.setattr(where, lambda run, step=step: [[step]])
        (loss,) = _found(run)
        assert loss.count == 5
        assert abs(loss.row - 7000) < 3 * loss.row_std


def test_a_path_of_lags_that_leaves_more_than_their_first_order_is_not_taken(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where it misses an instant by seconds, it is nearer than no loss at all, and farther than the loss."""
    run = _seen(root, Hidden("dropped_trigger", None, {"row": 4200, "count": 9}))
    wrong = [Step(2.0, 0.02), Step(3.0, -0.011)]
    monkeypatch.setattr("diagnosis.screening.lost_rows.lost_triggers.lag_steps", lambda run: [wrong])
    assert energy(_aligned(run, wrong)[0]) < energy(run)
    (loss,) = _found(run)
    assert loss.count == 9
    assert abs(loss.row - 4200) < 3 * loss.row_std + 20


def test_rows_that_lose_their_weight_are_no_gain(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Angles that are wrong where a made-up loss leaves no weight: what it leaves elsewhere is worse."""
    residuals = _residuals(root)
    t, q, i = residuals.samples[0]
    wrong = q + 0.3 * ((t > 7.2) & (t < 8.3))[:, None] * (np.arange(6) == 1)
    run = residual_run("run", residuals.runs[0].arm, t, wrong, i)
    residuals = replace(residuals, runs=[run], samples=[(t, wrong, i)])
    made_up = [DroppedTriggers(0, 7000.0, 10.0, 1500, 1.0, PERIOD)]
    monkeypatch.setattr("diagnosis.screening.residuals.dropped_triggers", lambda runs, periods: made_up)
    assert realigned(residuals, []) is residuals


def test_a_joint_whose_current_changes_on_one_side_alone_does_not_count() -> None:
    rng, pieces, after = np.random.default_rng(3), 20, np.arange(20) >= 10
    lag = np.where(after[:, None], 2e-3, 0.0) + rng.normal(0.0, 1e-6, (pieces, 3))
    weight = np.full((pieces, 3), 1e10)
    # without any change the lag of a piece is a quotient of two roundings
    lag[after, 2], weight[~after, 2] = rng.normal(0.0, 1e6, 10), 0.0
    with np.errstate(over="raise"):
        found = _change(lag, weight, np.arange(20.0), 10)
    assert found is not None
    assert found.step == pytest.approx(2e-3, abs=2e-6)


def test_steps_of_lost_rows_follow_one_another() -> None:
    assert in_order([Step(2.5, 0.03), Step(5.0, 0.06), Step(8.2, -0.01)])
    # what friction that the model had too much of chose in a recording of 125 Hz
    assert not in_order([Step(3.68, -4.57), Step(2.70, 4.80)])
    assert in_order([Step(3.4, -1.5), Step(3.6, 0.5)]) and not in_order([Step(1.0, -1.5)])


@pytest.mark.parametrize(
    "hidden",
    [
        Hidden("friction_drift", 1, {"fraction": 0.3, "time_constant": 5.0}),
        Hidden("joint_compliance", 2, {"stiffness": 1e4}),
        Hidden("backlash", 2, {"half_gap": 2e-3}),
        Hidden("current_gain", 3, {"error": 0.1}),
        None,
    ],
)
def test_other_effects_are_not_taken_for_lost_edges(root: Path, hidden: Hidden | None) -> None:
    assert _found(_seen(root, *([hidden] if hidden else []))) == []


def test_one_joint_alone_proves_no_lost_edges(root: Path) -> None:
    """The same change of lag at one joint, the others hardly moving.

    Something is wrong there, but nobody else saw an edge lost.
    """
    whole = _seen(root, Hidden("dropped_trigger", None, {"row": 4200, "count": 3}))
    plain = _seen(root)
    current, rate = plain.current.copy(), 1e-3 * plain.current_rate
    current[:, 3], rate[:, 3] = whole.current[:, 3], whole.current_rate[:, 3]
    assert len(_found(whole)) == 1
    assert _found(replace(plain, current=current, current_rate=rate)) == []


def _of_two_links(root: Path, count: int, *, coulomb: float) -> Run:
    """250 rows/s of an arm whose second joint turns against ``coulomb`` times its friction; rows lost at 5.87 s."""
    arm, rng = read_model(root / "config/starters/csv/model.toml"), np.random.default_rng(1)
    rough = replace(arm.joints[1], coulomb=(coulomb * arm.joints[1].coulomb[0], coulomb * arm.joints[1].coulomb[1]))
    arm, t = replace(arm, joints=(arm.joints[0], rough)), np.arange(3500) / 250.0
    q = sum(
        rng.normal(size=2) / 2 / k * np.sin(0.3 * np.pi * k * t[:, None] + rng.uniform(0.0, 6.0, 2))
        for k in range(1, 6)
    )
    i = predicted_current(arm, t, np.asarray(q))
    i += 0.02 * i.std(axis=0) * rng.standard_normal(i.shape)
    rows = np.arange(len(t))
    return residual_run("run", arm, t, np.asarray(q), i[np.minimum(rows + count * (rows >= 1468), len(t) - 1)])


def test_joints_that_show_another_part_of_a_lag_agree_once_it_is_put_back(root: Path) -> None:
    """Friction turns abruptly: of 12 ms, the first-order effect shows 11 ms at one joint and 6 at the other."""
    run = _of_two_links(root, 3, coulomb=4.0)
    first = change_of_lag(run)
    assert first is not None and abs(first.step) < SIGNIFICANT_STDS * first.std
    (loss,) = dropped_triggers([run], [0.004])
    assert loss.count == 3
    assert abs(loss.row - 1468) < 3 * loss.row_std
    assert dropped_triggers([_of_two_links(root, 0, coulomb=4.0)], [0.004]) == []


def test_friction_that_turns_round_otherwise_chooses_no_lag(root: Path) -> None:
    """As the arm starts, it fits the friction of a model that is ten times as abrupt 80 ms earlier."""
    t, q, v, a = motion(4, 12.0)
    i = torque(q, v, a, Day(width=0.1)) / DRIVE + 0.005 * np.random.default_rng(4).normal(size=q.shape)
    lost = np.concatenate([i[:1500], i[1509:], np.repeat(i[-1:], 9, axis=0)])
    run = residual_run("run", two_link.model(root), t, q, lost)
    by_all_rows, by_certain_rows = lag_steps(run)
    assert by_all_rows[0].time < 1.5
    (step,) = by_certain_rows
    assert abs(step.step - 0.036) < 0.01 and abs(step.time - 6.0) < 0.2
    (loss,) = dropped_triggers([run], [0.004])
    assert loss.count == 9


def test_currents_are_put_back_where_they_belong() -> None:
    true = np.arange(100.0)[:, None] ** 2
    lost = np.concatenate([true[:40], true[43:], np.repeat(true[-1:], 3, axis=0)])
    loss = DroppedTriggers(0, row=40.0, row_std=1.0, count=3, count_std=0.05, period=1e-3)
    put = realigned_rows(lost, loss)
    assert np.array_equal(put[43:], true[43:])
    assert np.array_equal(put[:40], true[:40])


def test_a_skew_named_in_their_place_does_not_keep_lost_edges_from_being_found(root: Path) -> None:
    """A search that did not know of the loss named the mean lag; with it in the model, the loss is found."""
    residuals = _residuals(root, Hidden("dropped_trigger", None, {"row": 4975, "count": 4}))
    between = [EffectTerm("time_skew", None, {"delay": -2e-3})]
    (event,) = realigned(residuals, between).events
    assert {p.name: p.value for p in event.parameters}["count"] == 4


@pytest.mark.filterwarnings("error")
def test_a_joint_whose_current_never_changes_has_no_say() -> None:
    """Its lag is noise without weight, however large: the step is that of the other two, 2 ms."""
    rng = np.random.default_rng(4)
    lag = 0.002 * (np.arange(40) >= 17)[:, None] + rng.normal(size=(40, 3)) * (1e-6, 1e-6, 1e10)
    weight = np.column_stack([np.full((40, 2), 1e6), np.zeros(40)])
    weight[0, 2] = 1e-3
    change = _change(lag, weight, np.arange(40) * 0.25, 17)
    assert change is not None and change.step == pytest.approx(0.002, rel=1e-2)


def test_a_change_is_as_certain_as_the_few_pieces_that_tell_it_agree() -> None:
    """Eight pieces with nearly all of the weight, each off by 1 ms, had a std of 0.2 ms beside many light ones."""
    rng, weight = np.random.default_rng(4), np.full((80, 1), 1e5)
    moving = [3, 10, 20, 33, 45, 55, 65, 75]
    weight[moving] = 3e7
    steps, stds = [], []
    for _ in range(200):
        lag = rng.normal(size=weight.shape) / np.sqrt(weight)
        lag[moving] += 1e-3 * rng.normal(size=(len(moving), 1))
        change = _change(lag, weight, np.arange(80) * 0.25, 40, agree=False)
        assert change is not None
        steps.append(change.step)
        stds.append(change.std)
    assert np.sqrt(np.mean(np.square(stds))) == pytest.approx(np.std(steps), rel=0.3)
