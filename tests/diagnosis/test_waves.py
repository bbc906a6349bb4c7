"""A residual that oscillates at one frequency is told with it, and what follows the motion or is noise is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from diagnosis.residual.filters import low_pass
from diagnosis.selection.waves import wave_of

ROWS, RATE = 1400, 100.0


@dataclass(frozen=True)
class Recorded:
    """Two recordings of two joints, as a dataset has them."""

    t: np.ndarray

    @property
    def runs(self) -> tuple[Recorded, Recorded]:
        return self, self

    @property
    def rows(self) -> int:
        return 2 * len(self.t)

    def by_recording(self, values: np.ndarray) -> list[np.ndarray]:
        return np.split(values.reshape(2, self.rows).T, 2)


def _oscillating(rng: np.random.Generator, frequency: float) -> np.ndarray:
    """(ROWS,) a wave that stops and starts again at another phase every 2 s."""
    t = np.arange(ROWS) / RATE
    phase = np.repeat(rng.uniform(0, 6, ROWS // 200), 200)
    return 3.0 * np.sin(2 * np.pi * frequency * t + phase)


@pytest.mark.parametrize("frequency", [4.3, 8.6])
def test_an_oscillation_that_stops_and_starts_has_its_frequency(frequency: float) -> None:
    rng, side = np.random.default_rng(3), Recorded(np.arange(ROWS) / RATE)
    noise = low_pass(rng.normal(size=(2, 2 * ROWS)).T, 20.0, RATE).T
    wave = np.concatenate([_oscillating(rng, frequency), _oscillating(rng, frequency)])
    told = wave_of((noise + [[0.0], [1.0]] * wave).ravel(), side, 2)  # type: ignore[arg-type]
    assert told is not None
    assert abs(float(told.removeprefix("a wave of ").removesuffix(" Hz")) - frequency) < 0.3
    assert wave_of((noise + [[0.0], [1.0]] * wave).ravel(), side, 1) is None  # type: ignore[arg-type]


def test_what_follows_a_slow_motion_is_no_wave() -> None:
    rng, side = np.random.default_rng(4), Recorded(np.arange(ROWS) / RATE)
    noise = low_pass(rng.normal(size=(2, 2 * ROWS)).T, 20.0, RATE).T
    steps = 5.0 * np.sign(np.sin(2 * np.pi * 0.4 * np.arange(2 * ROWS) / RATE))
    assert wave_of((noise + steps).ravel(), side, 1) is None  # type: ignore[arg-type]


def test_recordings_too_short_for_a_spectrum_show_none() -> None:
    assert wave_of(np.ones(800), Recorded(np.arange(200) / RATE), 1) is None  # type: ignore[arg-type]
