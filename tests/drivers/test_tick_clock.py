"""Host times of ticks from readings with round trips, some of them long and lopsided."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.tick_clock import TickClock

NOMINAL = 40e6


@pytest.mark.parametrize("ppm", [-100.0, 0.0, 100.0])
def test_late_answers_do_not_bend_the_line(ppm: float) -> None:
    random = np.random.default_rng(4)
    clock = TickClock(NOMINAL)
    errors = []
    for k in range(60):
        truth = int(1e9 + k * 0.25e9)
        tick = int((truth - 1e9) * 1e-9 * NOMINAL * (1 + ppm * 1e-6))
        out = 100_000 + int(random.integers(0, 10_000))
        back = out if random.random() < 0.5 else out + int(random.exponential(20e6))  # held up on the way back
        clock.add(tick, truth + (back - out) // 2, out + back)
        if k > 2:
            errors.append(int(clock.host(np.array([tick]))[0]) - truth)
    # Nominal for the first two seconds: 100 ppm of 2 s; then what the good readings' own spread allows.
    assert np.abs(errors).max() < 2.5e9 * abs(ppm) * 1e-6 + 30_000
    assert np.abs(errors[20:]).max() < 30_000


@given(
    trips=st.lists(st.tuples(st.integers(1_000, 30_000_000), st.floats(0.0, 1.0)), min_size=1, max_size=30),
    ppm=st.floats(-100, 100),
    restart=st.integers(0, 30),
)
@settings(max_examples=100)
def test_told_times_never_go_back_and_are_right_within_a_round_trip(
    trips: list[tuple[int, float]], ppm: float, restart: int
) -> None:
    """Readings of any round trip, split in any way; the counter may begin anew. Ten rows between two readings."""
    clock, errors, bounds = TickClock(NOMINAL), [], []
    rate = NOMINAL * (1 + ppm * 1e-6)
    for k, (trip, share) in enumerate(trips):
        truth = int(1e9 + k * 0.25e9)
        if k == restart:
            clock.restart()
        clock.add(int(truth * 1e-9 * rate), truth + int((share - 0.5) * trip), trip)
        at = truth + np.arange(10) * 25_000_000
        errors.append(clock.host((at * 1e-9 * rate).astype(np.int64)) - at)
        bounds.append(trip)
    host = np.concatenate(errors) + np.concatenate([1e9 + k * 0.25e9 + np.arange(10) * 25e6 for k in range(len(trips))])
    assert (np.diff(host) > 0).all()
    # Late by a reading's error at most, and by what the rate may be off from nominal before it is known.
    assert np.abs(np.concatenate(errors)).max() <= 2 * max(bounds) + 100e-6 * 0.25e9 * len(trips) + 10
