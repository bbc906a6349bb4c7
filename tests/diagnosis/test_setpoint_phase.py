"""When the setpoints came: two signals that are the same but for a known lag of no whole number of rows."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.closed_loop.setpoint_phase import lag_of


@pytest.mark.parametrize("rows", [1500, 1501])
@pytest.mark.parametrize("rate", [100.0, 1000.0])
@pytest.mark.parametrize("share", [-0.9, -0.137, 0.0, 0.5034])
def test_a_lag_between_rows_is_found(rows: int, rate: float, share: float) -> None:
    """Sums of sines below a fifth of the rate, in noise; the lag is a share of the largest that is looked for."""
    rng = np.random.default_rng(rows)
    t, lag = np.arange(rows) / rate, 0.02 * share
    waves = [(rng.uniform(0.01, 0.2) * rate, rng.uniform(0, 6.3), rng.uniform(1, 9)) for _ in range(40)]

    def signal(shift: float) -> np.ndarray:
        at = t - shift
        columns = [
            sum(size * np.sin(2 * np.pi * f * at + phase + joint) for f, phase, size in waves) for joint in range(3)
        ]
        return np.column_stack(columns) + rng.normal(size=(rows, 3))

    assert lag_of(signal(lag), signal(0.0), rate) == pytest.approx(lag, abs=0.01 / rate)
