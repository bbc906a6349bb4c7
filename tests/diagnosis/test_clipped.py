"""A current that is clipped piles up at its limit.

One that reverses of its own accord, or rests at its largest value for a while, does not.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.screening.current_limit import current_limits


def _recorded(path: Path, current: np.ndarray, noise: float, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    t = np.arange(len(current)) * 1e-3
    step = 0.01
    i = np.round((current + rng.normal(0.0, noise, len(current))) / step) * step
    write_table(path, t, {"q": np.cumsum(current)[:, None] * 1e-3, "i": i[:, None]}, Attachments())
    return open_recording(path)


def _motion(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 15.0, 1e-3)
    return sum(
        a * np.sin(2 * np.pi * f * t + p) for a, f, p in zip((2.0, 1.0, 0.7), (0.3, 0.7, 1.3), rng.uniform(0, 6, 3))
    )


@pytest.mark.parametrize("noise", [0.002, 0.007, 0.015])
@pytest.mark.parametrize("seed", range(3))
def test_a_limit_is_found_with_its_value(tmp_path: Path, noise: float, seed: int) -> None:
    free = _motion(seed)
    limit = 0.75 * float(np.abs(free).max())
    (event,) = current_limits([_recorded(tmp_path / "a.mcap", np.clip(free, -limit, limit), noise, seed)])
    (parameter,) = event.parameters
    assert abs(parameter.value - limit) < 2 * parameter.std < 0.1 * limit


@pytest.mark.parametrize("seed", range(6))
def test_peaks_and_slow_tops_are_no_limit(tmp_path: Path, seed: int) -> None:
    free = _motion(seed)
    t = np.arange(len(free)) * 1e-3
    # constant acceleration against viscous friction: a flat-looking top that rises by 5 %, the same in every stroke
    strokes = 3.0 * np.sign(np.sin(2 * np.pi * 0.5 * t)) * (1.0 + 0.05 * np.mod(t, 1.0)) * (np.mod(t, 1.0) < 0.3)
    for name, current in (("peaks", free), ("strokes", strokes)):
        assert current_limits([_recorded(tmp_path / f"{name}.mcap", current, 0.005, seed)]) == []
