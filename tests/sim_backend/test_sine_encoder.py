"""Sine encoders, comparators and counters against a decoder that is clocked through the signals sample by sample."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.counting import extend
from drivers.protocols import CounterMode
from sim_backend.electronics import noise, quadrature, sine_encoder
from sim_backend.electronics.sine_encoder import SineEncoder

LINES = 250.0
COUNTS_PER_LINE = {CounterMode.X1: 1, CounterMode.X2: 2, CounterMode.X4: 4}


def _encoder(**changes: float) -> SineEncoder:
    """One encoder."""
    values = {
        "lines": LINES,
        "sine_gain": 1.0,
        "cosine_gain": 1.0,
        "sine_offset": 0.0,
        "cosine_offset": 0.0,
        "phase_error": 0.0,
        "noise": 0.0,
        "hysteresis": 0.05,
    }
    return SineEncoder(**{name: np.array([value]) for name, value in (values | changes).items()})


def _passed(encoder: SineEncoder, angle: NDArray, noises: tuple[NDArray, NDArray]) -> list[NDArray]:
    """Edges passed of lines A and B at each of the angles (m, 1), the motor having come from the first."""
    phi = sine_encoder.phase(encoder, angle)
    passed = []
    for line, its_noise in zip(sine_encoder.lines_of(encoder), noises):
        lowest, highest = sine_encoder.bounds(*sine_encoder.place(line, phi), *sine_encoder.switching(line, its_noise))
        passed.append(sine_encoder.follow(lowest, highest, lowest[0]))
    return passed


def _comparator(signal: NDArray, hysteresis: float, high: bool) -> NDArray:
    """Schmitt trigger, written as its data sheet says it: the oracle."""
    out = np.empty(len(signal), bool)
    for k, value in enumerate(signal):
        high = True if value > hysteresis else False if value < -hysteresis else high
        out[k] = high
    return out


def _signals(encoder: SineEncoder, angle: NDArray, noise_a: NDArray, noise_b: NDArray) -> tuple[NDArray, NDArray]:
    """Sine and cosine (m, 1) as they reach the comparators; noise in standard deviations."""
    phi = encoder.lines * angle
    sine = encoder.sine_offset + encoder.sine_gain * np.sin(phi) + encoder.noise * noise_a
    cosine = encoder.cosine_offset + encoder.cosine_gain * np.cos(phi + encoder.phase_error) + encoder.noise * noise_b
    return sine, cosine


def _levels(passed: NDArray) -> NDArray:
    """Level of a line: high past an even edge."""
    return (passed & 1) == 0


def _decoded(a: NDArray, b: NDArray) -> tuple[NDArray, NDArray]:
    """What an x4 decoder clocked once a row makes of the levels (m,) of two lines: counts from row 0, and errors.

    A row in which both lines changed at once is an error: its direction cannot be known, and it counts nothing.
    """
    place = np.array([2, 3, 1, 0])[2 * a.astype(int) + b]
    step = np.diff(place, axis=0, prepend=place[:1]) & 3
    return np.cumsum(np.where(step == 2, 0, np.where(step == 3, -1, step))), step == 2


def _motion(seed: int, samples: int) -> NDArray:
    """A random motion with reversals, of at most a fortieth of a line a sample: fine enough for a clocked decoder."""
    random = np.random.default_rng(seed)
    speed = np.convolve(random.normal(size=samples + 200), np.ones(200) / 200, "valid")[:samples]
    speed *= 0.025 / np.abs(speed).max()
    return np.cumsum(speed)[:, None] * 2 * np.pi / LINES


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32),
    sine_gain=st.floats(0.7, 1.3),
    cosine_gain=st.floats(0.7, 1.3),
    sine_offset=st.floats(-0.2, 0.2),
    cosine_offset=st.floats(-0.2, 0.2),
    phase_error=st.floats(-0.3, 0.3),
    hysteresis=st.floats(0.01, 0.2),
    noise_level=st.floats(0.0, 0.03),
)
def test_edges_are_those_of_comparators_and_decoder_clocked_through(
    seed: int, noise_level: float, hysteresis: float, **errors: float
) -> None:
    encoder = _encoder(noise=noise_level, hysteresis=hysteresis, **errors)
    angle = _motion(seed, 3000)
    noises = tuple(noise.normals(noise.keys(seed, "test", 1), np.arange(len(angle))[:, None], 2))
    passed_a, passed_b = _passed(encoder, angle, noises)
    a, b = _signals(encoder, angle, *noises)
    level_a = _comparator(a[:, 0], hysteresis, bool(_levels(passed_a)[0, 0]))
    level_b = _comparator(b[:, 0], hysteresis, bool(_levels(passed_b)[0, 0]))
    assert (level_a == _levels(passed_a)[:, 0]).all()
    assert (level_b == _levels(passed_b)[:, 0]).all()
    clocked, error = _decoded(level_a, level_b)
    assert not error.any()
    counts = quadrature.count(passed_a, passed_b, CounterMode.X4)[:, 0]
    assert (counts - counts[0] == clocked).all()


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32), mode=st.sampled_from(list(CounterMode)), stride=st.integers(1, 500))
def test_counts_give_the_angle_back_within_one_count(seed: int, mode: CounterMode, stride: int) -> None:
    """However coarsely it is sampled, and through reversals: nothing is lost between samples."""
    encoder = _encoder(hysteresis=0.02)
    angle = _motion(seed, 5000)[::stride] * 40
    quiet = np.zeros_like(angle)
    counts = quadrature.count(*_passed(encoder, angle, (quiet, quiet)), mode)
    per_radian = COUNTS_PER_LINE[mode] * LINES / (2 * np.pi)
    error = counts - angle * per_radian  # a count stands for the interval from itself to the next
    widening = 0.02 * 4 / (2 * np.pi) * 1.01
    assert error.max() <= widening and error.min() >= -1.0 - widening


@given(passed=st.integers(-(2**40), 2**40))
def test_modes_count_one_two_and_four_a_line(passed: int) -> None:
    ideal_a = np.array([passed // 2])  # both lines, edge by edge: A's edges at even quarters, B's at odd
    ideal_b = np.array([(passed + 1) // 2])
    x1, x2, x4 = (int(quadrature.count(ideal_a, ideal_b, mode)[0]) for mode in CounterMode)
    assert x4 == passed and x2 == x4 // 2 and x1 == x4 // 4


def test_noise_at_standstill_chatters_only_where_it_exceeds_the_hysteresis() -> None:
    samples = 20_000
    noises = tuple(noise.normals(noise.keys(3, "test", 1), np.arange(samples)[:, None], 2))
    for angle in (0.0, 0.5 * np.pi / LINES, 1e-4 / LINES):  # on an edge of A, on one of B, beside one
        still = np.full((samples, 1), angle)
        quiet = quadrature.count(*_passed(_encoder(noise=0.01), still, noises), CounterMode.X4)
        assert np.ptp(quiet) == 0, "five times the noise: the comparator holds its level"
        noisy = quadrature.count(*_passed(_encoder(noise=0.03), still, noises), CounterMode.X4)
        assert np.ptp(noisy) <= 1, "one line chatters, the count goes one up and one down"
    chatter = quadrature.count(*_passed(_encoder(noise=0.03), np.zeros((samples, 1)), noises), CounterMode.X4)
    assert np.ptp(chatter) == 1


def test_hysteresis_is_lost_motion_of_its_own_width() -> None:
    """Back and forth: the edges come back 2 asin(h / gain) of phase later."""
    there = np.linspace(0.0, 40 * np.pi, 200_001) / LINES
    angle = np.concatenate([there, there[::-1]])[:, None]
    encoder = _encoder(hysteresis=0.1, sine_gain=0.8)
    quiet = np.zeros_like(angle)
    passed, _ = _passed(encoder, angle, (quiet, quiet))
    forth, back = passed[: len(there), 0], passed[len(there) :, 0][::-1]
    edges = np.arange(5, 30)
    width = (there[np.searchsorted(forth, edges)] - there[np.searchsorted(back, edges)]) * LINES
    assert np.allclose(width, 2 * np.arcsin(0.1 / 0.8), atol=3e-3)


@given(start=st.integers(-(2**30), 2**30), bits=st.sampled_from([16, 24, 32]), seed=st.integers(0, 2**32))
def test_a_wrapped_register_extends_to_what_was_counted(start: int, bits: int, seed: int) -> None:
    half = 1 << (bits - 1)
    steps = np.random.default_rng(seed).integers(-half + 1, half, 50)
    counts = start + np.cumsum(steps)
    register = quadrature.wrap(counts, bits)
    assert register.min() >= 0 and register.max() < 1 << bits
    assert (extend(register, bits, start) == counts).all()


def test_play_forgets_as_its_definition_does() -> None:
    random = np.random.default_rng(5)
    lowest = np.cumsum(random.integers(-1, 2, (5000, 3)), axis=0)
    highest = lowest + random.integers(0, 2, lowest.shape)
    passed = now = np.array([7, -4, 0])
    expected = []
    for low, high in zip(lowest, highest):
        now = np.minimum(np.maximum(now, low), high)
        expected.append(now)
    assert (sine_encoder.follow(lowest, highest, passed) == expected).all()


def test_a_sine_that_never_switches_is_refused() -> None:
    with pytest.raises(ValueError, match="cosine does not reach"):
        _encoder(cosine_gain=0.1, cosine_offset=0.06)
