"""Noise of the encoders in accelerations makes no inertia of a slow recording smaller than that of a fast one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comparison.from_recordings import compare_recordings
from comparison.joint_fit.encoder_noise import without_noise
from identification.preprocessing import signals
from identification.preprocessing.signals import equation_rows, equation_weight, parallel_filter, smooth_motion
from identification.preprocessing.spectrum import Band, choose_band
from identification.ripples import wide
from tests.comparison.second_day import motion, puma, record

STEP = 1e-4
"""rad, of encoders of the Puma, seen at its joints."""


def shaken(q: np.ndarray, dt: float) -> Band:
    """The band of an arm that a servo shakes now and then: what is above a slow motion is not cut off."""
    return replace(choose_band(q, dt), motion=27.0, parallel=18.0)


def inertia(root: Path, speed: float) -> float:
    """kg m2 by a fit of the torque of 1 kg m2 that encoders of STEP see move at a ``speed``."""
    t = np.arange(int(60.0 * 1000.0)) / 1000.0
    q, _, qdd = motion(t, 1, 0, speed)
    read = np.round(q / STEP) * STEP
    seen = wide(smooth_motion(t, read, qdd, band=shaken(read, t[1])))
    clean = without_noise(seen, puma(root, 1))
    weight, rows = equation_weight(clean), equation_rows(clean)[1][:, 0]
    x, y = (parallel_filter(clean, of * weight)[rows, 0] for of in (clean.qdd, seen.torque))
    return float(x @ y / (x @ x))


@pytest.mark.parametrize("speed", [0.1, 0.2, 1.0])
def test_an_inertia_is_that_of_slow_motions_too(root: Path, speed: float) -> None:
    assert inertia(root, speed) == pytest.approx(1.0, abs=0.01)


def test_nothing_is_named_where_one_recording_is_slower(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signals, "choose_band", shaken)
    arm = puma(root, 2)
    common: dict[str, Any] = {"seconds": 60.0, "rate": 500.0, "turn": 0.01, "step": STEP}
    pair = [record(tmp_path / f"{k}.mcap", arm, k, seed=k, speed=v, **common) for k, v in enumerate((0.15, 0.4))]
    assert compare_recordings(pair[:1], pair[1:], arm).significant == []
