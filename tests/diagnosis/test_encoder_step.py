"""The step of an encoder, from samples that a controller scaled, converted and printed."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from arm_io.types import Array
from diagnosis.residual.noise.channels import resolution
from diagnosis.residual.noise.encoder_step import encoder_step


def _motion(rate: float, seed: int, seconds: float = 15.0) -> Array:
    """(m,) rad: four sines of 1 to 6 rad/s, of random size and phase."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    frequency, phase, size = rng.uniform(1, 6, 4), rng.uniform(0, 6, 4), rng.uniform(0.1, 1, 4)
    waves = size[:, None] * np.sin(frequency[:, None] * t + phase[:, None])
    return np.asarray(0.8 * waves.sum(axis=0) / size.sum())


def _counted(q: Array, step: float, offset: float = 0.0) -> Array:
    return step * np.floor(q / step) + offset


RATES = st.sampled_from([100.0, 125.0, 250.0, 500.0, 1000.0])
SEEDS = st.integers(0, 1000)


@settings(max_examples=60)
@given(
    bits=st.integers(10, 23), ratio=st.floats(1.0, 4.0), offset=st.floats(-4, 4), rate=RATES, seed=SEEDS, noise=SEEDS
)
# One distance is three steps, the others are one; the first step that is proposed is two.
@example(bits=10, ratio=1.208984375, offset=0.0, rate=1000.0, seed=814, noise=680)
def test_the_step_of_any_encoder_behind_any_gear(
    bits: int, ratio: float, offset: float, rate: float, seed: int, noise: int
) -> None:
    """Also where noise before the quantisation is larger than the step."""
    step = 2 * np.pi / 2**bits / ratio
    q = _motion(rate, seed)
    assert encoder_step(_counted(q, step, offset)) == pytest.approx(step, rel=1e-3)
    q = q + 2.0 * step * np.random.default_rng(noise).normal(size=q.shape)
    assert encoder_step(_counted(q, step, offset)) == pytest.approx(step, rel=1e-3)


@settings(max_examples=60)
@given(
    bits=st.integers(10, 20),
    digits=st.integers(3, 9),
    degrees=st.booleans(),
    single=st.booleans(),
    rate=RATES,
    seed=SEEDS,
)
def test_a_count_that_was_printed_is_the_count_or_its_last_digit(
    bits: int, digits: int, degrees: bool, single: bool, rate: float, seed: int
) -> None:
    """Unless both are alike: they beat, and of the two either is found."""
    step, last = 2 * np.pi / 2**bits, 10.0**-digits * (np.pi / 180 if degrees else 1.0)
    assume(not 0.3 * step < last < 3.0 * step)
    q = _counted(_motion(rate, seed), step)
    q = np.deg2rad(np.round(np.rad2deg(q), digits)) if degrees else np.round(q, digits)
    q = q.astype(np.float32).astype(float) if single else q
    assert encoder_step(q) == pytest.approx(max(step, last), rel=0.02)


@settings(max_examples=40)
@given(rate=RATES, seed=SEEDS, noise=st.sampled_from([0.0, 1e-6, 1e-4]))
def test_angles_without_steps_have_none(rate: float, seed: int, noise: float) -> None:
    """Their noise is their scatter."""
    rng = np.random.default_rng(seed)
    q = _motion(rate, seed)
    q = q + noise * rng.normal(size=q.shape)
    assert encoder_step(q) == 0.0
    if noise:
        assert resolution(q) == pytest.approx(np.sqrt(12) * noise, rel=0.15)


@pytest.mark.parametrize("rows", [5, 12, 30, 60, 300])
def test_few_values_have_a_step_only_if_rows_repeat_them(rows: int) -> None:
    rng = np.random.default_rng(rows)
    assert all(encoder_step(rng.normal(size=rows)) == 0.0 for _ in range(50))
    standing = 0.3 + 1e-4 * rng.integers(0, 3, 40)
    assert encoder_step(np.asarray(standing, float)) == pytest.approx(1e-4)
    assert encoder_step(np.full(rows, 0.7)) == 0.0 and encoder_step(np.array([])) == 0.0


def test_a_single_pass_at_nearly_constant_speed() -> None:
    """All neighbouring values are 79 to 81 steps apart. The same motion without steps is taken for no lattice."""
    t = np.arange(3000) / 250.0
    q = 0.2 * t + 1e-3 * np.sin(1.7 * t)
    assert encoder_step(_counted(q, 1e-5)) == pytest.approx(1e-5, rel=1e-6)
    assert encoder_step(q) == 0.0


def test_a_million_rows_take_no_longer_than_a_few_sorts() -> None:
    q = _counted(_motion(1000.0, 1, 1000.0), 2 * np.pi / 2**20)
    began = time.process_time()
    np.unique(q)
    sorted_in, began = time.process_time() - began, time.process_time()
    assert encoder_step(q) == pytest.approx(2 * np.pi / 2**20, rel=1e-6)
    assert time.process_time() - began < 20.0 * sorted_in
