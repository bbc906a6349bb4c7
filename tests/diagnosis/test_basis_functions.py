"""Functions that a residual may depend on, against the same written row by row."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy import signal

from arm_io.types import Array
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.measurements.currents.structure.basis_functions import _plane_wave, _play
from diagnosis.measurements.currents.structure.noise_ratio import noise_at_rest
from diagnosis.measurements.currents.structure.shared_bases import harmonics_of, variables
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import QUIET_ROWS, _about_lines, is_stationary
from tests.diagnosis import two_link


def _row_by_row(values: Array, width: float) -> Array:
    kept, at = np.empty_like(values), float(values[0])
    for row, value in enumerate(values.tolist()):
        at = min(max(at, value - width), value + width)
        kept[row] = at
    return kept


@pytest.mark.parametrize("rows", [1, 2, 3, 64, 1000])
def test_play_is_a_clamp_per_row(rows: int) -> None:
    values = np.cumsum(np.random.default_rng(rows).standard_normal(rows))
    widths = np.array([0.1, 1.0, 5.0, 50.0])
    assert np.array_equal(_play(values, widths), np.stack([_row_by_row(values, w) for w in widths], axis=1))


def test_the_strongest_wave_of_two_angles_is_found() -> None:
    random = np.random.default_rng(1)
    own, other = np.cumsum(random.standard_normal((2, 3000)), axis=1) / 20
    for c, d in ((2.5, 1.0), (-3.0, 4.5), (0.5, 8.0)):
        wave = np.sin(c * own + d * other + 0.7) + 0.3 * random.standard_normal(3000)
        assert _plane_wave(wave, harmonics_of(own), harmonics_of(other)) == (c, d)


@pytest.mark.parametrize("correlated", [0.0, 0.03, 0.1, 0.15])
def test_noise_is_stationary_however_it_is_correlated(correlated: float) -> None:
    """Of 15 s, a twentieth of whose rows do not count; its rms alone is up to twice that of its quietest seconds."""
    random, keeps = np.random.default_rng(2), np.exp(-0.01 / correlated) if correlated else 0.0
    block, stationary = np.arange(1500) // 100, 0
    for _ in range(20):
        noise = signal.lfilter([1.0], [1.0, -keeps], random.standard_normal(3000))[1500:]
        rows = np.flatnonzero(random.random(1500) > 0.05)
        stationary += is_stationary(noise, block, rows)
        assert not is_stationary(noise * np.where(block % 3 == 0, 1.0, 0.3), block, rows)
        assert not is_stationary(noise + 5.0 * np.std(noise) * np.linspace(-1.0, 1.0, 1500) ** 3, block, rows)
        assert not is_stationary(noise, block, rows[:300])
    assert stationary >= 18


def test_noise_of_parts_of_seconds_is_stationary_as_well() -> None:
    """A joint that moves for half of each of 15 s: no second has enough rows, two together have."""
    random, keeps = np.random.default_rng(3), np.exp(-0.01 / 0.05)
    block, stationary = np.arange(1500) // 100, 0
    rows = np.flatnonzero(np.arange(1500) % 100 < 50)
    for _ in range(20):
        noise = signal.lfilter([1.0], [1.0, -keeps], random.standard_normal(3000))[1500:]
        stationary += is_stationary(noise, block, rows)
        assert not is_stationary(noise * np.where(block % 6 < 2, 1.0, 0.3), block, rows)
        assert not is_stationary(noise, block, rows[:250])
    assert stationary >= 18


def test_deviations_are_from_straight_lines() -> None:
    random = np.random.default_rng(2)
    residual = random.standard_normal(2000) + np.linspace(0.0, 30.0, 2000)
    rows, block = np.flatnonzero(random.random(2000) > 0.3), np.arange(2000) // 100
    stds = []
    for number in range(20):
        own = rows[block[rows] == number]
        if len(own) >= QUIET_ROWS:
            line = np.polynomial.Polynomial.fit(own, residual[own], 1)
            stds.append(np.std(residual[own] - line(own)))
    assert _about_lines(rows, residual[rows], block[rows]) == pytest.approx(stds)


def test_a_function_of_the_current_does_not_follow_the_noise_of_its_transducer(root: Path) -> None:
    """The measured current has the residual in it: a function of it explained more than the gain that was wrong."""
    arm, (t, q, v, a) = two_link.model(root), two_link.motion(1, 12.0)
    current = two_link.torque(q, v, a, two_link.Day()) / two_link.DRIVE
    noise = 0.1 * np.random.default_rng(1).normal(size=current.shape)
    sides = [dataset_of([residual_run("run", arm, t, q, measured)]) for measured in (current, 1.1 * current + noise)]
    clean, noisy = (dict(variables(side, arm, 1)) for side in sides)
    for name in ("current", "current of joint 2"):
        assert np.ptp(clean[name]) > 1.0
        np.testing.assert_array_equal(noisy[name], clean[name])


@pytest.mark.parametrize("size", [1.0, 3.0])
def test_a_joint_that_rests_shows_its_slow_noise(size: float) -> None:
    """Of a wrist that moved for one second of 30, slow noise was three times what the initial standstill shows.

    The quietest seconds, about straight lines, have less of it than all: three quarters.
    """
    rng, t = np.random.default_rng(4), np.arange(3000) / 100.0
    slow = signal.lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], rng.normal(size=3000)) * size
    slow[1500:1800] += 50.0 * np.sin(t[1500:1800])  # while it moves
    moving = (t >= 15.0) & (t < 18.0)
    run = SimpleNamespace(
        t=t,
        residual=slow[:, None] + 7.0,
        brisk_v=np.where(moving, 0.3, 0.0)[:, None],
        noise=np.ones(1),
    )
    side = cast(Any, SimpleNamespace(runs=(run,)))
    assert 0.6 * size < noise_at_rest(side, 1) < size
    run.brisk_v = np.full((3000, 1), 0.3)
    assert noise_at_rest(side, 1) == 0.0
