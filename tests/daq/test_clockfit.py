"""Device clocks against the host's: drift that bends, jitter that is late, and what the fit says about itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.acquisition.clock_fit import MOST_PAIRS, ArrivalClock, ClockPairs, fit_clock


@given(st.integers(0, 10_000), st.floats(-200e-6, 200e-6), st.floats(1e3, 1e8))
def test_a_steady_clock_is_found_with_its_rate(seed: int, drift: float, rate: float) -> None:
    random = np.random.default_rng(seed)
    true = np.sort(random.uniform(0, 60, 2000))
    ticks = np.round(true * rate * (1 + drift)).astype(np.int64) + 12345
    host = 10**17 + np.round(true * 1e9 + random.normal(0, 20_000, 2000)).astype(np.int64)
    fit = fit_clock("card", list(zip(ticks.tolist(), host.tolist())))
    assert fit is not None
    assert fit.tick_rate == pytest.approx(rate * (1 + drift), rel=6 * np.hypot(fit.std_ns[0], fit.std_ns[-1]) / 60e9)
    resolution = 1e9 / rate
    assert fit.residual_rms == pytest.approx(np.hypot(20_000, resolution / np.sqrt(12)), rel=0.15)
    error = fit.to_host(ticks) - (10**17 + true * 1e9)
    assert np.abs(error).max() < 6 * max(fit.std_ns) + resolution


def test_a_crystal_that_wanders_is_followed_where_one_line_would_not_do() -> None:
    random = np.random.default_rng(1)
    true = np.arange(0, 300, 0.05)
    wander = 40e-6 * 60 / (2 * np.pi) * np.sin(2 * np.pi * true / 60)  # +-40 ppm over a minute
    ticks = np.round((true + wander) * 1e6).astype(np.int64)
    host = np.round(true * 1e9 + random.normal(0, 10_000, len(true))).astype(np.int64)
    fit = fit_clock("card", list(zip(ticks.tolist(), host.tolist())))
    line = fit_clock("card", list(zip(ticks.tolist(), host.tolist())), knot_seconds=1e9)
    assert fit is not None and line is not None
    bent = np.abs(fit.to_host(ticks) - true * 1e9)
    straight = np.abs(line.to_host(ticks) - true * 1e9)
    assert np.sqrt(np.mean(bent**2)) < 0.2 * np.sqrt(np.mean(straight**2))


def test_the_stated_uncertainty_is_the_scatter_of_repeated_fits() -> None:
    random = np.random.default_rng(2)
    true = np.arange(0, 20, 0.01)
    ticks = np.round(true * 1e6).astype(np.int64)
    found, stated = [], []
    for _ in range(200):
        host = np.round(true * 1e9 + random.normal(0, 5_000, len(true))).astype(np.int64)
        fit = fit_clock("card", list(zip(ticks.tolist(), host.tolist())))
        assert fit is not None
        found.append(fit.host_ns)
        stated.append(fit.std_ns)
    assert np.std(found, axis=0) == pytest.approx(np.mean(stated, axis=0), rel=0.2)


def test_a_long_run_keeps_few_pairs_and_the_fit_of_all() -> None:
    """A week of blocks is as many pairs as an hour's; what they say is the same, within its uncertainty."""
    random = np.random.default_rng(3)
    true = np.arange(3 * MOST_PAIRS + 1) * 0.01
    ticks = np.round(true * 1e6 * (1 + 30e-6)).astype(np.int64)
    host = np.round(true * 1e9 + random.normal(0, 5_000, len(true))).astype(np.int64)
    kept, most = ClockPairs(), 0
    for tick, at in zip(ticks.tolist(), host.tolist()):
        kept.add(tick, at)
        most = max(most, len(kept.kept))
    assert MOST_PAIRS / 2 < len(kept.kept) <= most == MOST_PAIRS
    assert kept.kept == list(zip(ticks.tolist(), host.tolist()))[:: kept.stride]
    few, every = fit_clock("card", kept.kept), fit_clock("card", list(zip(ticks.tolist(), host.tolist())))
    assert few is not None and every is not None
    away = np.abs(few.to_host(ticks) - every.to_host(ticks))
    assert away.max() < 6 * np.hypot(max(few.std_ns), max(every.std_ns))
    assert few.residual_rms == pytest.approx(every.residual_rms, rel=0.1)


@pytest.mark.parametrize("pairs", [[], [(1, 1), (2, 2)], [(5, 1), (5, 2), (5, 3)]])
def test_what_cannot_be_fitted_is_none(pairs: list[tuple[int, int]]) -> None:
    assert fit_clock("card", pairs) is None


@given(
    blocks=st.lists(st.integers(1, 40), min_size=30, max_size=120),
    drift=st.floats(-1e-3, 1e-3),
    seed=st.integers(0, 1000),
)
def test_arrival_stamps_become_increasing_times_that_follow_the_trigger(
    blocks: list[int], drift: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    period = 1e6 * (1 + drift)
    clock, first = ArrivalClock(1e6), 0
    times, true = [], []
    for rows in blocks:
        index = np.arange(first, first + rows)
        first += rows
        arrival = int(10**15 + first * period + random.exponential(200_000))
        times.append(clock.times(index, np.full(rows, arrival, np.int64)))
        true.append(10**15 + (index + 1) * period)
    made, wanted = np.concatenate(times), np.concatenate(true)
    assert (np.diff(made) > 0).all()
    assert np.median(np.abs(made - wanted)[len(made) // 2 :]) < 1.0 * 1e6


def test_a_trigger_that_is_slower_than_its_rig_is_followed() -> None:
    """By 0.1 % for 20 s in blocks of 50 rows: without following, the times would be 20 ms early at the end."""
    clock, period = ArrivalClock(1e6), 1e6 * 1.001
    for first in range(0, 20_000, 50):
        index = np.arange(first, first + 50)
        made = clock.times(index, np.full(50, round((first + 50) * period)))
    np.testing.assert_allclose(made, (index + 1) * period, atol=0.2e6)


def test_a_block_that_comes_late_puts_no_later_block_before_it() -> None:
    """A host that was busy at first: its times are 20 ms late, and are led back by half a period a block."""
    clock, arrivals = ArrivalClock(1e6), [25_000_000] + [5_000_000 * (k + 1) for k in range(1, 60)]
    blocks = [clock.times(np.arange(5 * k, 5 * k + 5), np.full(5, arrival)) for k, arrival in enumerate(arrivals)]
    assert (np.diff(np.concatenate(blocks)) > 0).all()
    late = [int(block[-1]) - 5_000_000 * (k + 1) for k, block in enumerate(blocks)]
    assert late[0] == 20_000_000 and late[-1] == 0
