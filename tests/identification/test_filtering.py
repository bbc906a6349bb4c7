"""Filters forwards and backwards against scipy's own, to the last bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import signal

from identification.preprocessing import zero_phase

FILTERS: tuple[tuple[int, Any, str], ...] = (
    (4, 0.1, "lowpass"),
    (4, 0.7, "highpass"),
    (3, [0.1, 0.3], "band"),
    (3, 0.2, "lowpass"),
)


@pytest.mark.parametrize("design", FILTERS)
@pytest.mark.parametrize("shape", [(300,), (300, 6), (301, 1), (300, 3, 4)])
@pytest.mark.parametrize("pad", [None, 0, 50, 299])
def test_every_row_is_that_of_scipy(design: tuple[int, Any, str], shape: tuple[int, ...], pad: int | None) -> None:
    order, edge, kind = design
    sections = signal.butter(order, edge, kind, output="sos")
    values = np.random.default_rng(3).standard_normal(shape)
    its_own = signal.sosfiltfilt(sections, values, axis=0, **({} if pad is None else {"padlen": pad}))
    assert np.array_equal(zero_phase(sections, values, pad=pad), its_own)


def test_a_pad_as_long_as_the_rows_is_refused() -> None:
    with pytest.raises(ValueError, match="10 rows"):
        zero_phase(signal.butter(2, 0.2, output="sos"), np.zeros(10), pad=10)
