"""An effect that acts in few blocks: a joint that moves once in a recording, or a short one."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.residual.comparable_rows import rms_where
from diagnosis.residual.generation import residual_run
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset
from diagnosis.selection.regression import fit_together, score
from identification.selection import Score, Split, p_value
from tests.diagnosis import two_link
from tests.diagnosis.two_link import DRIVE, Day, torque

SECONDS, ROWS = 15, 120
DRAG = Candidate("hydrodynamic_drag", 1)


def _side(y: np.ndarray) -> Dataset:
    run = SimpleNamespace(t=np.arange(len(y)) / ROWS)
    return Dataset((run,), (run,), y, np.arange(len(y)) // ROWS, len(y))  # type: ignore[arg-type]


def _moved_once(at: float, size: float) -> np.ndarray:
    """(m,) what drag does while a joint moves from a place to another for 1.5 s, over the noise."""
    inside = np.clip((np.arange(SECONDS * ROWS) / ROWS - at) / 1.5, 0.0, 1.0)
    return size * (30 * inside**2 * (1 - inside) ** 2 / 1.875) ** 2


def _chance(x: Split[np.ndarray], y: Split[np.ndarray]) -> float:
    columns = x.map(lambda values: values.reshape(len(values), -1))
    data, pair = y.map(_side), columns.map(lambda values: Columns(values, slice(0, len(values))))
    return score(DRAG, pair, fit_together(data, []), data.held_out).p


def test_a_large_effect_of_one_quick_move_is_significant() -> None:
    """By signs of two blocks it would be one in four."""
    rng = np.random.default_rng(1)
    x = Split(_moved_once(4.3, 1.0), _moved_once(8.6, 1.0))
    assert _chance(x, x.map(lambda one: 10.0 * one + rng.normal(size=len(one)))) < 2e-3
    # ... and a small one is not, as before
    assert _chance(x, x.map(lambda one: 1.0 * one + rng.normal(size=len(one)))) > 0.02


def test_half_of_the_noise_is_large_for_one_coefficient_but_not_for_four() -> None:
    """More of them would follow another law at the same instants."""
    rng = np.random.default_rng(3)
    x = Split(_moved_once(4.3, 1.0), _moved_once(8.6, 1.0))
    y = x.map(lambda one: 4.5 * one + rng.normal(size=len(one)))
    assert _chance(x, y) < 2e-3
    powers = x.map(lambda one: np.stack([one**k for k in range(1, 5)], axis=1))
    assert _chance(powers, y) > 0.02


def test_what_has_nothing_to_do_with_a_residual_is_seldom_significant() -> None:
    """However large and slow the residual is."""
    rng, smooth = np.random.default_rng(2), np.hanning(ROWS)
    low, trials = 0, 200
    for _ in range(trials):
        x = Split(*(_moved_once(float(rng.uniform(1, 13)), 1.0) for _ in range(2)))
        low += _chance(x, x.map(lambda one: np.convolve(rng.normal(size=len(one)), smooth, "same"))) < 0.01
    assert low <= 0.02 * trials


def test_a_joint_without_rows_that_are_compared_counts_all_of_them() -> None:
    values, rows = np.array([[3.0, 1.0], [4.0, 7.0]]), np.array([[False, True], [False, False]])
    assert rms_where(values, rows) == pytest.approx([np.sqrt(12.5), 1.0])


def test_few_seconds_confirm_a_delay_that_all_recordings_show(root: Path) -> None:
    """Their signs agree by chance with a probability of some thousandths; that of joint 1 alone shows no delay."""
    arm, skew = two_link.model(root), Candidate("time_skew", None)

    def scored(late: tuple[float, float]) -> Score[Candidate]:
        runs = []
        for seed in range(3):
            t, q, v, a = two_link.motion(seed, 12.0)
            current = torque(q, v, a, Day()) / DRIVE
            current = np.stack([np.interp(t - by, t, one) for by, one in zip(late, current.T)], axis=1)
            current += 0.005 * np.random.default_rng(seed).normal(size=q.shape)
            runs.append(residual_run("", arm, t, q, current))
        data = Split(dataset_of(runs[:2]), dataset_of(runs[2:]))
        model = Currents(arm, data, Library((skew,), data), [])
        (found,) = model.scores(model.start())
        return found

    both, one = scored((4e-4, 4e-4)), scored((4e-4, 0.0))
    assert both.p < 1e-6 < 1e-4 < p_value(both.blocks)
    assert one.p > 1e-4
