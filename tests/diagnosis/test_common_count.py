"""Rows lost alike in several recordings, of which no single one determines how many: found by all of them together."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from arm_model.model_file import read_model
from diagnosis.cause import Structure
from diagnosis.current_diagnosis import CurrentDiagnosis
from diagnosis.residual.expected_current import predicted_current
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows import lost_triggers
from diagnosis.screening.lost_rows.common_count import common_count
from diagnosis.screening.lost_rows.losses import DroppedTriggers
from diagnosis.screening.lost_rows.lost_triggers import dropped_triggers
from diagnosis.unexplained import changes_of_lag

RATE, ROW = 500.0, 2000
"""Rows per s, and the row after which triggers are lost."""


def _run(
    root: Path,
    seed: int,
    lost: tuple[int, int],
    *,
    noise: float | tuple[float, float] = 0.01,
    slowly: bool = False,
    row: int = ROW,
) -> Run:
    """10 s of two joints of which mostly one moves, with so many rows of currents lost at each after a row.

    noise: as a share of the current, of both joints or of each.
    """
    arm, rng = read_model(root / "config/starters/csv/model.toml"), np.random.default_rng(seed)
    t = np.arange(5000) / RATE
    turn = np.stack([np.exp(-(((t - centre) / 1.3) ** 2)) + 0.15 for centre in rng.permutation([2.7, 5.6])], axis=1)
    waves = sum(rng.normal(size=2) / k * np.sin(2.0 * k * t[:, None] + rng.uniform(0.0, 6.0, 2)) for k in range(1, 5))
    q = np.asarray(0.25 * turn * waves)
    i = np.asarray(predicted_current(arm, t, q))
    gone = np.clip((np.arange(len(t)) - 500) / 4000, 0.0, 1.0) if slowly else np.arange(len(t)) >= row
    rows = np.arange(len(t))[:, None] + gone[:, None] * np.array(lost)
    i = np.stack([np.interp(at, np.arange(len(t)), column) for at, column in zip(rows.T, i.T)], axis=1)
    other = np.cumsum(rng.normal(size=i.shape), axis=0)
    other -= np.stack([np.convolve(column, np.ones(60) / 60, "same") for column in other.T], axis=1)
    i += np.array(noise) * i.std(axis=0) * (rng.normal(size=i.shape) + other / other.std())
    return residual_run(f"run {seed}", arm, t, q, i)


def _common(runs: list[Run]) -> int | None:
    found = common_count(runs, [1.0 / RATE] * len(runs))
    return None if found is None else found.count


@pytest.mark.parametrize("count", [2, 3, -3])
def test_rows_that_every_recording_lost_are_found_by_all_together(root: Path, count: int) -> None:
    runs = [_run(root, seed, (count, count)) for seed in range(6)]
    alone = [dropped_triggers([run], [1.0 / RATE]) for run in runs]
    together = dropped_triggers(runs, [1.0 / RATE] * len(runs))
    assert len(together) > sum(map(len, alone))
    assert {loss.count for loss in together} == {count}
    for loss in together:
        assert abs(loss.row - ROW) < 3 * loss.row_std


@pytest.mark.parametrize("count", [6, -5, 9])
def test_a_joint_that_hardly_tells_one_number_from_the_next_is_no_contradiction(root: Path, count: int) -> None:
    runs = [_run(root, seed, (count, count), noise=(0.003, 0.02)) for seed in range(6)]
    assert _common(runs) == count


def test_a_change_of_lag_is_told_where_its_rows_are_not_certain(root: Path) -> None:
    """Seven rows, to a third of one: a single recording of several joints was ``consistent`` beside it."""
    lost, whole = (_run(root, 2, rows, noise=0.02) for rows in ((7, 7), (0, 0)))
    assert dropped_triggers([lost], [1.0 / RATE]) == []

    def told(run: Run) -> list[Structure]:
        state = SimpleNamespace(all_runs=[run], terms=())
        return changes_of_lag(cast(CurrentDiagnosis, SimpleNamespace(state=state)))

    (structure,) = told(lost)
    assert structure.against == "time" and structure.size.startswith("-14.3 (0.6) ms of lag of all currents, run 2")
    assert told(whole) == told(_run(root, 2, (7, 0), noise=0.02)) == []


@pytest.mark.parametrize(("count", "noise"), [(5, 0.03), (9, 0.04), (-7, 0.04)])
def test_rows_that_are_less_than_the_number_is_known_to_are_lost_where_all_joints_changed(
    root: Path, count: int, noise: float
) -> None:
    runs = [_run(root, seed, (count, count), noise=noise) for seed in range(6)]
    found = common_count(runs, [1.0 / RATE] * 6)
    assert found is not None and found.count_std > 0.3
    assert abs(found.count - count) < 2 * found.count_std
    assert len(found.instants) >= 5


@pytest.mark.parametrize(("late", "noise"), [(9, 0.02), (-9, 0.01), (25, 0.01)])
def test_a_time_skew_longer_than_those_that_a_loss_may_have_beside_it_is_no_loss(
    root: Path, late: int, noise: float
) -> None:
    assert _common([_run(root, seed, (late, late), noise=noise, row=0) for seed in range(6)]) is None


def test_recordings_that_lost_nothing_are_left_as_they_are(root: Path) -> None:
    runs = [_run(root, seed, (2, 2) if seed < 4 else (0, 0), noise=0.006) for seed in range(6)]
    found = common_count(runs, [1.0 / RATE] * 6)
    assert found is not None and found.count == 2
    assert set(found.instants) <= {0, 1, 2, 3}


@pytest.mark.parametrize("lost", [(0, 0), (2, 0), (2, -2)])
def test_joints_that_show_no_common_change_lost_no_rows(root: Path, lost: tuple[int, int]) -> None:
    assert _common([_run(root, seed, lost, noise=0.003) for seed in range(6)]) is None


def test_a_lag_that_grows_slowly_is_no_loss(root: Path) -> None:
    assert _common([_run(root, seed, (2, 2), noise=0.003, slowly=True) for seed in range(6)]) is None


def test_a_lag_that_changes_by_no_whole_number_of_rows_is_no_loss(root: Path) -> None:
    runs = [_run(root, seed, (3, 3), noise=0.003) for seed in range(6)]
    assert common_count(runs, [2.0 / RATE] * 6) is None


def test_a_number_that_one_recording_shows_is_looked_for_in_all_others(root: Path) -> None:
    """Seven rows at 250 Hz, which one recording showed by itself, were more than the 20 ms that several were asked."""
    runs = [_run(root, seed, (13, 13)) for seed in range(6)]
    periods = [1.0 / RATE] * len(runs)
    assert common_count(runs, periods) is None
    found = common_count(runs, periods, shown=13)
    assert found is not None and found.count == 13 and len(found.instants) >= 5


@pytest.mark.parametrize(("std", "stays"), [(1.0, False), (0.2, True)])
def test_a_recording_that_knows_its_number_less_surely_has_that_of_all(
    root: Path, monkeypatch: pytest.MonkeyPatch, std: float, *, stays: bool
) -> None:
    """One of eight rows, known to one, and another of seven: every phase of a ripple was wrong in the first."""
    own = DroppedTriggers(0, ROW + 20.0, 10.0, 4, std, 1.0 / RATE)
    monkeypatch.setattr(lost_triggers, "_of_recording", lambda index, run, period: [own] if index == 0 else [])
    found = dropped_triggers([_run(root, seed, (3, 3)) for seed in range(6)], [1.0 / RATE] * 6)
    assert found[0].count == (4 if stays else 3)
    assert {loss.count for loss in found[1:]} == {3}
