"""Host times of ticks from readings with round trips, some of them long and lopsided."""

from __future__ import annotations

import numpy as np
import pytest

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
