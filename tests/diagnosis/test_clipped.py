"""A current that is clipped piles up at its limit.

One that reverses of its own accord, or rests at its largest value for a while, does not; nor one that holds a joint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage, signal

import armscope
from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import total_at
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.screening.current_limit import current_limits
from diagnosis.screening.current_piles import Pile, edge_of, pile_of
from tests.comparison.second_day import puma, record
from tests.diagnosis.one_axis import FREE


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
    (event,) = current_limits([_recorded(tmp_path / "a.mcap", np.clip(free, -limit, limit), noise, seed)], FREE)
    (parameter,) = event.parameters
    assert abs(parameter.value - limit) < 2 * parameter.std < 0.1 * limit


@pytest.mark.parametrize("seed", range(6))
def test_peaks_and_slow_tops_are_no_limit(tmp_path: Path, seed: int) -> None:
    free = _motion(seed)
    t = np.arange(len(free)) * 1e-3
    # constant acceleration against viscous friction: a flat-looking top that rises by 5 %, the same in every stroke
    strokes = 3.0 * np.sign(np.sin(2 * np.pi * 0.5 * t)) * (1.0 + 0.05 * np.mod(t, 1.0)) * (np.mod(t, 1.0) < 0.3)
    for name, current in (("peaks", free), ("strokes", strokes)):
        assert current_limits([_recorded(tmp_path / f"{name}.mcap", current, 0.005, seed)], FREE) == []


@pytest.mark.parametrize("limit", [None, 1.2])
def test_a_current_that_a_standing_joint_holds_is_no_limit(tmp_path: Path, limit: float | None) -> None:
    # friction keeps the joint where it stopped, an integral keeps the current at which it did: for seconds, and at
    # more than what the joint takes while it moves slowly
    rng, t = np.random.default_rng(1), np.arange(0.0, 16.0, 1e-3)
    q = np.where(t < 5.0, 0.4 * np.sin(0.9 * t) ** 2, 0.4 * np.sin(4.5) ** 2)
    free = 1.5 * np.sign(np.gradient(q)) * np.abs(np.sin(5.0 * t))
    free[t >= 5.0] = 1.6
    i = free if limit is None else np.clip(free, -limit, limit)
    i = np.round((i + rng.normal(0.0, 0.005, len(t))) / 0.01) * 0.01
    signals = {"q": q[:, None], "i": i[:, None], "qref": q[:, None]}
    write_table(tmp_path / "run.mcap", t, signals, Attachments())
    found = current_limits([open_recording(tmp_path / "run.mcap")], FREE)
    assert [one.effect for one in found] == ([] if limit is None else ["current_limit"])


@pytest.mark.parametrize("limit", [None, 0.5])
def test_a_current_that_others_exceed_is_no_limit_though_the_joint_lags_meanwhile(
    tmp_path: Path, limit: float | None
) -> None:
    """One slow move against friction, in which a servo without feed-forward lags as it never did before."""
    rng, recordings, t = np.random.default_rng(2), [], np.arange(0.0, 3.2, 1e-3)
    moves = ndimage.uniform_filter1d(np.repeat([0.0, 1.0, 0.0], [700, 2000, 500]), 60)
    for name, speed, varies in (("slow", 0.15, 0.0), ("fast", 0.5, 0.06)):
        needed = moves * (0.5 - varies / 2 + varies * np.sin(9.0 * t))
        q, given = np.cumsum(speed * moves) * 1e-3, needed
        lag = 0.012 * speed * signal.lfilter([0.02], [1.0, -0.98], moves)
        if limit is not None:
            given = np.minimum(given, limit)
            lag = lag + np.cumsum(needed - given) * 1e-3
        i = np.round((given + 0.01 * rng.normal(size=len(q))) / 0.01) * 0.01
        table = {"q": q[:, None], "i": i[:, None], "qref": (q + lag)[:, None]}
        write_table(tmp_path / f"{name}.mcap", t, table, Attachments())
        recordings.append(open_recording(tmp_path / f"{name}.mcap"))
    found = [(one.effect, one.recordings) for one in current_limits(recordings, FREE)]
    assert found == ([] if limit is None else [("current_limit", (0, 1))])


def test_coulomb_friction_in_noise_is_no_limit(tmp_path: Path) -> None:
    # a wrist at many slow speeds: 0.16 A either way, a tenth of it uncertain
    rng, t = np.random.default_rng(2), np.arange(0.0, 16.0, 1e-3)
    q = 0.3 * np.sin(0.7 * t) + 0.1 * np.sin(1.9 * t)
    speed = np.gradient(q, t)
    i = (0.15 + 0.03 * np.abs(speed)) * np.tanh(speed / 0.005) + rng.normal(0.0, 0.012, len(t))
    i = np.round(i / 0.01) * 0.01
    signals = {"q": q[:, None], "i": i[:, None], "qref": q[:, None]}
    write_table(tmp_path / "run.mcap", t, signals, Attachments())
    assert current_limits([open_recording(tmp_path / "run.mcap")], FREE) == []


def _started(overshoot: float) -> np.ndarray:
    """A of a wrist that goes at two slow speeds, 5 and 4 s; its current starts higher by ``overshoot`` for 20 ms."""
    stretches = [(0.0, 200), (-0.33 - overshoot, 5), (-0.325, 1250), (0.0, 60), (-0.318, 1000), (0.0, 200), (0.1, 500)]
    return np.concatenate([np.full(count, level) for level, count in stretches])


@pytest.mark.parametrize("overshoot", [0.07, 0.0])
def test_a_level_that_a_start_exceeds_is_no_limit(overshoot: float) -> None:
    i = _started(overshoot)
    noisy = i + np.random.default_rng(3).normal(0.0, 0.01, len(i))
    assert pile_of([np.abs(ndimage.uniform_filter1d(noisy, 2))], 0.0072, 0.004).exceeded == (overshoot > 0.0)


@pytest.mark.parametrize("find", [pile_of, edge_of])
@pytest.mark.parametrize("count", [1, 3])
def test_one_wrong_row_does_not_exceed_a_level(
    find: Callable[[Sequence[Array], float, float], Pile], count: int
) -> None:
    """Of 13 s it is more than the share of the rows that may be above the levels that are tried."""
    wrong = np.tile(_started(0.0), count)
    wrong[1000] = -1.0
    pile = find([np.abs(ndimage.uniform_filter1d(wrong, 2))], 0.0072, 0.004)
    assert not pile.exceeded and pile.level == pytest.approx(0.325, abs=0.0072)


RATE, NOISE = 125.0, 0.012
"""Rows per s, and A of noise: 1.5 % of what joint 1 of the starter project's arm takes here."""


def _of_joint(
    path: Path,
    arm: Arm,
    acceleration: np.ndarray,
    inertia: float,
    limit: float | None,
    seed: int,
    noise: float = NOISE,
) -> Recording:
    """A log without demands of joint 1 at this acceleration (m,), with the friction that the arm has there."""
    t = np.arange(len(acceleration)) / RATE
    v = np.cumsum(acceleration) / RATE
    v -= v.mean()
    up, down = total_at(arm.joints[0], np.abs(v))
    i = (inertia * acceleration + np.where(v > 0.0, up, -down)) / arm.joints[0].drive_constant
    i = i if limit is None else np.clip(i, -limit * np.abs(i).max(), limit * np.abs(i).max())
    i = i + noise * np.abs(i).max() * np.random.default_rng(seed).normal(size=len(t))
    q = np.cumsum(v) / RATE
    still = np.zeros_like(q)
    signals = {"q": np.column_stack([q, still]), "i": np.column_stack([i, noise * np.sin(t)])}
    write_table(path, t, signals, Attachments())
    return open_recording(path)


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return armscope.read_model(root / "config/starters/csv/model.toml")


@pytest.mark.parametrize("seed", range(3))
def test_a_limit_in_noise_is_found_where_the_current_does_not_follow_the_friction(
    arm: Arm, tmp_path: Path, seed: int
) -> None:
    t = np.arange(0.0, 30.0, 1.0 / RATE)
    waves = np.sum([np.sin(2 * np.pi * f * t + seed + 2.0 * f) for f in (0.2, 0.3, 0.7)], axis=0)
    for limit in (None, 0.7):
        recording = _of_joint(tmp_path / f"{limit}.mcap", arm, waves, 0.5, limit, seed)
        found = current_limits([recording], arm)
        assert [one.joint for one in found] == ([] if limit is None else [1])
        if limit is not None:
            highest = float(np.quantile(np.abs(recording.i[:, 0]), 0.999))
            assert found[0].parameters[0].value == pytest.approx(highest, rel=0.06)


@pytest.mark.parametrize("inertia", [0.0, 0.5])
def test_a_joint_that_accelerates_alike_or_meets_its_friction_alone_is_not_clipped(
    arm: Arm, tmp_path: Path, inertia: float
) -> None:
    t = np.arange(0.0, 30.0, 1.0 / RATE)
    strokes = 0.1 * np.sign(np.sin(2 * np.pi * 0.4 * t))
    recording = _of_joint(tmp_path / "strokes.mcap", arm, strokes, inertia, None, 1)
    assert current_limits([recording], arm) == []


def test_a_single_crest_that_is_flat_is_no_limit(arm: Arm, tmp_path: Path) -> None:
    # a load that falls by what acceleration and friction grow, for half a second of 30
    t = np.arange(0.0, 30.0, 1.0 / RATE)
    recording = _of_joint(tmp_path / "crest.mcap", arm, np.sin(2 * np.pi * 0.25 * t), 0.5, None, 1)
    i, crest = recording.i.copy(), (t > 10.1) & (t < 10.6)
    i[crest, 0] += 1.3 * np.abs(i[:, 0]).max() - ndimage.uniform_filter1d(i[:, 0], 9)[crest]
    assert current_limits([replace(recording, i=i)], arm) == []


def _brief(path: Path, arm: Arm, limit: float | None, seed: int) -> Recording:
    """10 s of quick waves, whose crests last for tenths of a second."""
    t = np.arange(0.0, 10.0, 1.0 / RATE)
    waves = np.sum([np.sin(2 * np.pi * f * t + seed + 2.0 * f) for f in (1.1, 1.7, 0.6)], axis=0)
    return _of_joint(path, arm, waves, 0.5, limit, seed, 0.3 * NOISE)


@pytest.mark.parametrize("seed", range(6))
def test_a_limit_that_is_met_often_and_briefly_is_found(arm: Arm, tmp_path: Path, seed: int) -> None:
    """For some tenths of a second each time, in one of these for less than a second in all."""
    free, clipped = (_brief(tmp_path / f"{limit}.mcap", arm, limit, seed) for limit in (None, 0.85))
    (found,) = current_limits([clipped], arm)
    assert found.joint == 1
    assert found.parameters[0].value == pytest.approx(0.85 * np.abs(free.i[:, 0]).max(), rel=0.02)
    assert current_limits([free], arm) == []


@pytest.mark.parametrize("seed", range(4))
def test_a_limit_is_found_among_crests_that_end_just_below_it(arm: Arm, tmp_path: Path, seed: int) -> None:
    """Four crests of 15 reach it in each direction; the others leave as many rows just below."""
    t = np.arange(0.0, 30.0, 1.0 / RATE)
    for limit in (None, 0.75):
        rng = np.random.default_rng(seed)
        height = rng.uniform(0.73, 0.75, 15)
        height[[1, 5, 9, 12]] = 1.0, 0.95, 0.9, 0.97
        # the friction is a hundredth of what the inertia takes
        wave = height[np.minimum((t / 2.0).astype(int), 14)] * np.sin(np.pi * t)
        recording = _of_joint(tmp_path / f"{limit}.mcap", arm, 20.0 * wave, 100.0, limit, seed, 0.5 * NOISE)
        assert [one.joint for one in current_limits([recording], arm)] == ([] if limit is None else [1])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("limit", [None, 0.77])
def test_a_limit_is_found_where_as_many_rows_are_just_below_it(
    arm: Arm, tmp_path: Path, seed: int, limit: float | None
) -> None:
    """Crests of all heights; the commonest value is as much as a noise below the limit, which is 30 noises."""
    t, rng = np.arange(0.0, 40.0, 1.0 / RATE), np.random.default_rng(seed)
    height = rng.uniform(0.5, 1.05, 40)
    height[[3, 9, 15, 21, 28, 34]] = 1.25, 1.28, 1.23, 1.26, 1.3, 1.27
    wave = height[np.minimum(t.astype(int), 39)] * np.sin(np.pi * t)
    recording = _of_joint(tmp_path / "run.mcap", arm, 20.0 * wave, 100.0, limit, seed, 0.025)
    found = current_limits([recording], arm)
    assert [one.joint for one in found] == ([] if limit is None else [1])


def _slow(root: Path, path: Path, share: float) -> list[int | None]:
    """Joints whose limit is named in 24 slow recordings; joint 1 has one at this share of its largest current."""
    of, named = puma(root), []
    for seed in range(0, 72, 3):
        slow: dict[str, Any] = {"seed": seed, "speed": 0.3, "seconds": 8.0, "rate": 125.0}
        one = record(path, of, 2 * seed, **slow)
        if share < 1.0:
            largest = float(np.quantile(np.abs(one.i[:, 0]), 0.99))
            one = record(path, of, 2 * seed, **slow, limit=share * largest)
        named += [event.joint for event in current_limits([one], of)]
    return named


def test_crests_of_slow_motions_are_no_limit(root: Path, tmp_path: Path) -> None:
    """Coulomb friction, gravity and little else: currents of seconds within a few hundredths of their largest."""
    assert _slow(root, tmp_path / "run.mcap", 1.0) == []


def test_limits_of_slow_motions_are_found(root: Path, tmp_path: Path) -> None:
    """But for those of a joint that goes in one direction for nearly all of the time: one visit is no limit."""
    named = _slow(root, tmp_path / "run.mcap", 0.85)
    assert set(named) == {1} and len(named) > 20
