"""The deviations that are stated of a line near the mains, against its scatter in drawn noise."""

from __future__ import annotations

import numpy as np

from diagnosis.screening.mains_hum import _parameters
from diagnosis.screening.spectral_line import Line, line_near_mains


def _line(seed: int) -> tuple[Line, np.ndarray]:
    """A line in white noise and a slow motion, and frequency, amplitude and phase that it has."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, random.uniform(8.0, 20.0), 1 / 500)
    true = np.array([50.0 + random.uniform(-0.3, 0.3), random.uniform(0.01, 0.05), random.uniform(-3.0, 3.0)])
    hum = true[1] * np.sin(2 * np.pi * true[0] * t + true[2])
    return line_near_mains(t, hum + np.sin(2.0 * t) + random.normal(0.0, 0.03, len(t))), true


def test_frequency_amplitude_and_phase_scatter_as_stated() -> None:
    off = []
    for seed in range(60):
        line, (frequency, amplitude, phase) = _line(seed)
        turned = np.angle(np.exp(1j * (line.phase - phase)))
        stated = line.frequency_std, line.amplitude_std, line.phase_std
        off.append(np.array([line.frequency - frequency, line.amplitude - amplitude, turned]) / stated)
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert ((rms > 0.75) & (rms < 1.35)).all(), rms


def test_a_phase_that_is_another_in_every_recording_is_not_known() -> None:
    alike, others = (
        [Line(phase=p, phase_std=0.02) for p in phases] for phases in ([1.0, 1.01, 0.99], [1.0, -2.0, 2.9])
    )
    assert _parameters(alike)[2].std < 0.03
    assert _parameters(others)[2].std > 1.0
