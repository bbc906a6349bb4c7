"""Signals: derivatives against an exact motion, cut-offs from the spectrum, untrusted rows left out."""

from __future__ import annotations

import numpy as np
import pytest

from identification.preprocessing.signals import (
    equation_rows,
    equation_weight,
    flat_tops,
    parallel_filter,
    parallel_rows,
    parallel_window,
    smooth_motion,
    with_reversals,
)


def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two joints, three harmonics of 0.4 Hz each: position, speed, acceleration."""
    w = 2 * np.pi * 0.4
    q = [sum(a / k * np.sin(k * w * t + p) for k, a, p in terms) for terms in TERMS]
    v = [sum(a * w * np.cos(k * w * t + p) for k, a, p in terms) for terms in TERMS]
    a = [sum(-a * k * w**2 * np.sin(k * w * t + p) for k, a, p in terms) for terms in TERMS]
    return np.array(q).T, np.array(v).T, np.array(a).T


TERMS = (((1, 0.7, 0.0), (2, 0.3, 1.0), (5, 0.1, 2.0)), ((1, 0.4, 0.5), (3, 0.2, 0.1), (5, 0.1, 0.3)))


def test_derivatives_of_an_exact_motion_are_exact() -> None:
    t = np.arange(20_000) / 1000
    q, v, a = motion(t)
    got = smooth_motion(t, q, a)
    inside = got.usable[:, 0]
    for found, true in ((got.qd, v), (got.qdd, a)):
        assert np.max(np.abs((found - true)[inside])) < 1e-3 * np.max(np.abs(true))


@pytest.mark.parametrize("step", [1e-4, 1e-3])
def test_coarser_encoder_lowers_the_cut_off(step: float) -> None:
    t = np.arange(20_000) / 1000
    q, _, a = motion(t)
    fine, coarse = smooth_motion(t, np.rint(q / 1e-6) * 1e-6, a), smooth_motion(t, np.rint(q / step) * step, a)
    assert 2.0 < coarse.band.motion < fine.band.motion
    inside = coarse.usable[:, 0]
    assert np.std((coarse.qdd - a)[inside, 0]) < 0.15 * np.std(a[:, 0])


def test_jittered_stamps_are_respected() -> None:
    random = np.random.default_rng(3)
    even = np.arange(20_000) / 1000
    t = np.sort(even + random.uniform(-0.4e-3, 0.4e-3, len(even)))
    q, _, a = motion(t)
    true = motion(even)[2]
    with_stamps, without = smooth_motion(t, q, a), smooth_motion(even, q, a)
    grid = with_stamps.t + t[0]
    inside = with_stamps.usable[:, 0]
    error = np.std((with_stamps.qdd - motion(grid)[2])[inside])
    ignored = np.std((without.qdd - true)[without.usable[:, 0]])
    assert error < 0.02 * np.std(true)
    assert error < 0.5 * ignored


def test_gap_is_left_out_and_counted() -> None:
    t = np.arange(10_000) / 1000
    keep = (t < 4.0) | (t > 4.5)
    q, _, a = motion(t)
    got = smooth_motion(t[keep], q[keep], a[keep])
    assert 400 < got.excluded["gap"][0] < 1200
    hole = (got.t > 4.0) & (got.t < 4.5)
    assert not got.usable[hole].any()
    inside = got.usable[:, 0]
    assert np.max(np.abs((got.qdd - a)[inside])) < 0.02 * np.max(np.abs(a))


def test_missing_samples_of_one_joint_cost_the_rows_of_its_torque_only() -> None:
    t = np.arange(10_000) / 1000
    q, _, a = motion(t)
    torque = a.copy()
    torque[3000:3600, 1] = np.nan
    got = smooth_motion(t, q, torque)
    assert got.excluded["gap"][0] == 0
    assert got.excluded["gap"][1] >= 500


def test_standstill_is_left_out_and_a_reversal_is_not() -> None:
    t = np.arange(12_000) / 1000
    start = np.clip(t / 2.0, 0, 1)
    q = (start**3 * (10 - 15 * start + 6 * start**2))[:, None] * motion(t)[0]
    q = np.concatenate([np.zeros((3000, 2)), q])
    random = np.random.default_rng(1)
    q = q + 2e-6 * random.standard_normal(q.shape)
    got = smooth_motion(np.arange(len(q)) / 1000, q, q)
    assert got.excluded["standstill"][0] > 2000
    moving = got.t > 4.0
    assert got.usable[moving & (got.t < 14.0), 0].mean() > 0.97


def test_clipped_current_is_found() -> None:
    t = np.arange(5_000) / 1000
    q, _, a = motion(t)
    clipped = np.clip(a, -1.0, 1.0)
    assert flat_tops(clipped, q)[np.abs(a) > 1.05].all()
    assert not flat_tops(a, q).any()


def test_parallel_filter_keeps_slow_signals_and_their_time() -> None:
    t = np.arange(20_000) / 1000
    q, _, a = motion(t)
    got = smooth_motion(t, q, a)
    stamps, trusted = parallel_rows(got)
    assert len(stamps) == len(parallel_filter(got, got.qd)) == len(trusted)
    slow = np.sin(0.5 * got.t)
    expected = np.sin(0.5 * stamps)
    assert np.max(np.abs(parallel_filter(got, slow) - expected)) < 2e-3
    assert parallel_filter(got, np.empty((len(t), 0))).shape == (len(stamps), 0)  # of an arm that no load moves


def test_joint_that_is_only_shaken_has_no_say_in_the_band() -> None:
    """One joint through half a turn in 2 s, its neighbour pushed about by three counts.

    The thesis's runs of one joint at a time.
    """
    t = np.arange(3_700) / 1000
    s = np.clip((t - 0.8) / 2.0, 0, 1)
    q = np.pi * s**3 * (10 - 15 * s + 6 * s**2)
    shaken = 3e-4 * np.exp(-((t - 1.8) ** 2)) * np.sin(9 * t)
    step = 7e-5
    both = np.round(np.stack([q, shaken], axis=1) / step) * step
    both += 1e-6 * np.random.default_rng(0).standard_normal(both.shape)
    alone, together = smooth_motion(t, both[:, :1], both[:, :1]), smooth_motion(t, both, both)
    assert together.band.motion == alone.band.motion > 5.0
    assert together.usable[:, 0].sum() > 1500
    assert together.moves(0)
    assert not together.moves(1)


def test_fits_do_without_reversals_judgements_do_not() -> None:
    t = np.arange(20_000) / 1000
    q, v, a = motion(t)
    got = smooth_motion(t, q, a)
    moving = got.usable & (equation_weight(got) == 0)
    turn = np.diff(np.sign(v), axis=0) != 0
    inside = got.usable[1:] & got.usable[:-1]
    assert np.all(moving[1:][turn & inside])  # each reversal
    assert np.all(np.abs(v[moving]) < 0.2 * np.max(np.abs(v)))  # and little else
    whole = with_reversals(got)
    assert np.all(equation_weight(whole) == 1)
    assert np.array_equal(equation_rows(whole)[1], parallel_rows(got)[1])
    assert equation_rows(got)[1].mean() > 0.9


def test_parallel_filter_is_the_same_for_every_row() -> None:
    t = np.arange(7777) / 1000
    got = smooth_motion(t, np.sin(3 * t)[:, None], np.sin(3 * t)[:, None])
    columns = np.random.default_rng(0).standard_normal((len(t), 3, 2))
    step = parallel_window(got)[1]
    found = parallel_filter(got, columns)
    shifted = parallel_filter(got, np.roll(columns, step, axis=0))
    assert np.allclose(shifted[1:], found[:-1], atol=1e-12)


def test_jittered_stamps_keep_the_mean_of_a_ripple() -> None:
    """Kicks of a servo, steep up and slow down.

    An interpolation that never overshoots cuts their tops, and the mean with them.
    """
    random = np.random.default_rng(0)
    even = np.arange(8000) / 985.71
    jittered = even + 2e-5 * random.standard_normal(len(even))

    def transients(t: np.ndarray) -> np.ndarray:
        since = np.mod(t, 0.028)
        return np.exp(-since / 0.002) - np.exp(-since / 0.0004) - 0.0016 / 0.028

    means = []
    for t in (even, jittered):
        motion = smooth_motion(t, np.sin(2 * t)[:, None], transients(t)[:, None])
        means.append(float(np.mean(motion.torque[500:-500])))
    assert abs(means[1] - means[0]) < 2e-4
