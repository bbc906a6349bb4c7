"""A device that loses rows loses them again: several losses of one recording, long and short, row by row."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import CubicSpline

from arm_model.model_file import read_model
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows.lag_by_rows import PRICE, RowStep, _monotone, steps_by_rows
from diagnosis.screening.lost_rows.lag_change import part_of
from diagnosis.screening.lost_rows.lag_path import PIECE
from diagnosis.screening.lost_rows.losses import DroppedTriggers, unmeasured
from diagnosis.screening.lost_rows.lost_triggers import _by_rows, dropped_triggers
from tests.blind.laboratory import Laboratory
from tests.blind.motions import fourier
from tests.blind.record import Truth, recorded, truth

pytest.importorskip("numba", reason="the plant of the hidden-effect tests is compiled by numba")

PERIOD = 1e-3
LABORATORY = Laboratory("singles")
LOSSES = ((2500, 5), (5000, 8), (7500, 20))
"""Rows among the currents, and how many are lost there."""


@pytest.fixture(scope="module")
def healthy() -> Truth:
    """What an arm without a fault does for ten seconds."""
    return truth(fourier("run", 5, 0.12, 0.9, 10.0), (), LABORATORY)


def _lost(healthy: Truth, losses: tuple[tuple[int, int], ...], joints: slice = slice(None)) -> Truth:
    """Currents of some joints that from each row on belong to later ones."""
    signals = healthy.signals
    rows = np.arange(len(signals.t))
    later = sum((count * (rows >= row) for row, count in losses), np.zeros(len(rows)))
    current = signals.current.copy()
    current[:, joints] = CubicSpline(rows, signals.current)(np.minimum(rows + later, rows[-1]))[:, joints]
    return replace(healthy, signals=replace(signals, current=current))


def _run(root: Path, what: Truth) -> Run:
    rows = recorded(what, LABORATORY, 5)
    arm = read_model(root / "config" / "models" / "puma560.toml")
    return residual_run("run", arm, what.signals.t, rows.q, rows.i)


def test_three_losses_of_one_recording_are_found(root: Path, healthy: Truth) -> None:
    """Of three losses in each of three recordings of 18 s, 23 rows were found in one of them."""
    found = dropped_triggers([_run(root, _lost(healthy, LOSSES))], [PERIOD])
    assert [loss.count for loss in found] == [count for _, count in LOSSES]
    before = 0
    for loss, (row, count) in zip(found, LOSSES):
        assert abs(loss.row - row - before) < 3 * loss.row_std + 20
        assert loss.row_std < 200
        before += count


@pytest.mark.parametrize(
    ("losses", "joints"), [((), slice(None)), (((4000, 20),), slice(2, 3))], ids=["nothing", "one joint"]
)
def test_what_one_joint_shows_alone_is_no_loss(
    root: Path, healthy: Truth, losses: tuple[tuple[int, int], ...], joints: slice
) -> None:
    assert steps_by_rows(_run(root, _lost(healthy, losses, joints)), PERIOD) == []


def test_a_run_of_few_rows_shows_no_loss(root: Path, healthy: Truth) -> None:
    """Fewer than a piece of the path of lags has: no mean of a piece can be formed."""
    run = part_of(_run(root, _lost(healthy, LOSSES)), 5.0, 5.3)
    assert 2 < len(run.t) < PIECE and dropped_triggers([run], [PERIOD]) == []


def test_rows_that_are_no_whole_number_are_no_loss() -> None:
    """A lag that changes by 4.5 rows: an amplifier's filter was set anew, perhaps; nothing was lost.

    Beside a loss, what is known to half a row is one, too.
    """
    half, whole = RowStep(4.0, 4.5e-3, 0.02, 1e-4), RowStep(6.0, 9.1e-3, 0.02, 1e-4)
    assert _by_rows(0, [half], PERIOD) == []
    assert [loss.count for loss in _by_rows(0, [whole], PERIOD)] == [9]
    again = _by_rows(0, [RowStep(4.0, 4.4e-3, 0.02, 6e-4), whole], PERIOD)
    assert [(loss.row, loss.count, loss.count_std) for loss in again] == [
        (4000, 4, pytest.approx(0.6)),
        (6004, 9, pytest.approx(0.1)),
    ]


@given(arrays(float, (6, 4), elements=st.floats(0.0, 3.0 * PRICE)))
def test_the_path_is_the_cheapest_that_never_falls(cost: np.ndarray) -> None:
    def price(path: tuple[int, ...]) -> float:
        changes = sum(a != b for a, b in itertools.pairwise(path))
        return float(sum(cost[row, lag] for row, lag in enumerate(path)) + PRICE * changes)

    path, least = _monotone(cost)
    assert list(path) == sorted(path)
    every = [p for p in itertools.product(range(4), repeat=6) if list(p) == sorted(p)]
    assert least == pytest.approx(min(map(price, every)))
    assert price(tuple(path.tolist())) == pytest.approx(least)
    falling, of_falling = _monotone(cost[:, ::-1], reverse=True)
    assert list(falling) == sorted(falling, reverse=True)
    assert price(tuple(falling.tolist())) == pytest.approx(of_falling)


def test_rows_near_a_loss_whose_row_is_not_known_have_no_weight(root: Path, healthy: Truth) -> None:
    run = _run(root, healthy)
    for row_std, width in ((1.0, 0.0), (30.0, 0.22), (500.0, 0.3)):
        loss = DroppedTriggers(0, 5000.0, row_std, 3, 0.1, PERIOD)
        weighted = unmeasured(run, [loss]).deviation / run.deviation
        assert np.count_nonzero(weighted[:, 0] > 2.0) / run.per_second == pytest.approx(width, abs=0.03)
