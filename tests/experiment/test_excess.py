"""Limits of long motions: the verdict of a look at every instant, without one."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import InputError
from experiment import Demand, Experiment, demand_of, excess, experiment_of
from experiment.bounds import FELT, STEP
from experiment.excess import Kind, excesses, instants_of

START = [0.1, -0.2]
DAY = 86400.0


def experiment(segments: list[dict[str, Any]]) -> Experiment:
    return Experiment.model_validate(
        dict(name="test", start=START, full_speed=[1.0, 2.0], full_acceleration=[5.0, 8.0], segment=segments)
    )


def seen(demand: Demand) -> np.ndarray:
    """(4, n) lowest and highest position, largest speed and acceleration of a look at every instant.

    What the check is to find.
    """
    q = demand(np.arange(0.0, demand.duration + STEP, STEP))
    apart = round(FELT / STEP)
    bend = q[2 * apart :] - 2 * q[apart:-apart] + q[: -2 * apart]
    speed = np.abs(np.diff(q, axis=0)).max(axis=0, initial=0.0) / STEP
    return np.stack([q.min(axis=0), q.max(axis=0), speed, np.abs(bend).max(axis=0, initial=0.0) / FELT**2])


angle = st.floats(-2.0, 2.0).map(lambda x: round(x, 3))
seconds = st.floats(0.01, 4.0).map(lambda x: round(x, 3))
share = st.floats(0.05, 1.0).map(lambda x: round(x, 3))
rows = st.lists(st.lists(angle, min_size=3, max_size=3), min_size=2, max_size=2)


@st.composite
def series(draw: st.DrawFn) -> dict[str, Any]:
    duration = draw(st.floats(1.0, 6.0))
    fade = draw(st.floats(0.05, 0.5)) * duration
    return dict(
        type="fourier",
        duration=duration,
        fundamental=draw(st.floats(0.05, 3.0)),
        fade=fade,
        sine=draw(rows),
        cosine=draw(rows),
    )


@st.composite
def sweep(draw: st.DrawFn) -> dict[str, Any]:
    duration = draw(st.floats(1.0, 6.0))
    fade = draw(st.floats(0.05, 0.5)) * duration
    return dict(
        type="chirp",
        joint=draw(st.integers(1, 2)),
        amplitude=draw(angle),
        frequency=draw(st.floats(0.05, 8.0)),
        to_frequency=draw(st.floats(0.05, 8.0)),
        duration=duration,
        fade=fade,
    )


@st.composite
def table(draw: st.DrawFn) -> dict[str, Any]:
    steps = draw(st.lists(st.floats(0.003, 1.0), min_size=1, max_size=6))
    places = draw(st.lists(st.lists(angle, min_size=2, max_size=2), min_size=len(steps) + 1, max_size=len(steps) + 1))
    return dict(type="setpoints", times=[0.0, *np.cumsum(steps).tolist()], positions=places)


plain = st.one_of(
    st.builds(lambda d: dict(type="hold", duration=d), seconds),
    st.builds(lambda j, q, v: dict(type="drive", joint=j, to=q, speed=v), st.integers(1, 2), angle, share),
    st.builds(lambda j, q, v: dict(type="drive", joint=j, by=q, speed=v), st.integers(1, 2), angle, share),
    st.builds(lambda a, b, v: dict(type="move", to=[a, b], speed=v), angle, angle, share),
    series(),
    sweep(),
    table(),
)


def repeated(inner: st.SearchStrategy) -> st.SearchStrategy:
    return st.builds(
        lambda times, segments: dict(type="repeat", times=times, segment=segments),
        st.integers(1, 7),
        st.lists(inner, min_size=1, max_size=2),
    )


motions = st.lists(plain | repeated(plain | repeated(plain)), min_size=1, max_size=3)


def flat(segments: list[dict[str, Any]]) -> list[dict[str, Any]]:
    found = []
    for segment in segments:
        found += flat(segment["segment"]) * segment["times"] if segment["type"] == "repeat" else [segment]
    return found


@settings(max_examples=80)
@given(motions)
def test_what_is_repeated_is_what_is_written_out(segments: list[dict[str, Any]]) -> None:
    short, long = demand_of(experiment(segments)), demand_of(experiment(flat(segments)))
    assert short.duration == pytest.approx(long.duration, rel=1e-12, abs=1e-12)
    t = np.linspace(-0.1, long.duration + 0.1, 400)
    steady = np.abs(long(t + 1e-9) - long(t - 1e-9)).max(axis=1) < 1e-5  # not where a table jumps
    np.testing.assert_allclose(short(t)[steady], long(t)[steady], atol=1e-7)
    np.testing.assert_allclose(short.end, long.end, atol=1e-9)


@settings(max_examples=80)
@given(motions, st.data())
def test_bounds_hold_on_every_stretch(segments: list[dict[str, Any]], data: st.DataObject) -> None:
    demand = demand_of(experiment(segments))
    last = instants_of(demand)
    first = data.draw(st.integers(0, max(last - 1, 0)))
    stop = data.draw(st.integers(first, min(first + 3000, last)))
    q = demand(np.arange(first, stop + 2 * round(FELT / STEP) + 1) * STEP)
    apart = round(FELT / STEP)
    bend = q[2 * apart :] - 2 * q[apart:-apart] + q[: -2 * apart]
    found = [-q.min(axis=0), q.max(axis=0), np.abs(np.diff(q, axis=0)).max(axis=0) / STEP]
    found.append(np.abs(bend).max(axis=0) / FELT**2)
    reach = demand.bounds(first * STEP, (stop + 2 * apart) * STEP).reach
    assert (np.stack(found) <= reach + 1e-9 * (1 + np.abs(reach))).all()


@settings(max_examples=100)
@given(motions, st.integers(0, 3), st.integers(0, 1), st.floats(-0.2, 0.2), st.sampled_from([64, 512, 1 << 15]))
def test_the_verdict_is_that_of_a_look_at_every_instant(
    segments: list[dict[str, Any]], kind: int, joint: int, beyond: float, block: int
) -> None:
    """One limit, below or above what the motion asks for by some part of it.

    Looked at in blocks small enough to matter.
    """
    demand = demand_of(experiment(segments))
    value = float(seen(demand)[kind, joint])
    size = max(abs(value), 1e-3)
    limit = value + (-1 if kind == 0 else 1) * beyond * size
    limits: dict[str, np.ndarray] = {
        str(list(Kind)[kind]): np.where(np.arange(2) == joint, limit, -1e9 if kind == 0 else 1e9)
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiment.excess.BLOCK", block)
        found = excesses(demand, **limits)  # type: ignore[arg-type]
    exceeds = value < limit if kind == 0 else value > limit
    if abs(value - limit) > 1e-6 * size + 1e-9:  # phases of repeated passes within an instant
        assert [(one.kind, one.joint) for one in found] == [(list(Kind)[kind], joint + 1)] * exceeds
        assert not exceeds or found[0].value == pytest.approx(value, rel=1e-3, abs=1e-6)


HARMONICS = [[0.2, 0.1, 0.05], [0.3, 0.0, 0.1]]
LONG = {
    "hold": [dict(type="hold", duration=DAY)],
    "slow drive": [dict(type="drive", joint=1, by=1.0, speed=1.2e-5)],
    "fourier": [dict(type="fourier", duration=DAY, fundamental=0.1, sine=HARMONICS, cosine=HARMONICS, fade=1.0)],
    "slow fourier": [dict(type="fourier", duration=DAY, fundamental=1e-5, sine=HARMONICS, cosine=HARMONICS, fade=1e4)],
    "chirp": [dict(type="chirp", joint=2, amplitude=0.3, frequency=0.01, to_frequency=2.0, duration=DAY)],
    "table": [
        dict(
            type="setpoints",
            times=np.arange(0.0, DAY, 10.0).tolist(),
            positions=np.column_stack([np.sin(np.arange(8640)), np.cos(np.arange(8640))]).tolist(),
        )
    ],
    "repeat": [
        dict(
            type="repeat",
            times=3600,
            segment=[
                dict(type="fourier", duration=20.0, fundamental=0.1, sine=HARMONICS, cosine=HARMONICS),
                dict(type="drive", joint=1, by=0.1),
                dict(type="drive", joint=1, by=-0.1),
                dict(type="hold", duration=1.0),
            ],
        )
    ],
    "repeats in repeats": [
        dict(
            type="repeat",
            times=60,
            segment=[
                dict(
                    type="repeat",
                    times=1200,
                    segment=[
                        dict(type="drive", joint=1, by=0.1),
                        dict(type="drive", joint=1, by=-0.1),
                        dict(type="hold", duration=0.5),
                    ],
                )
            ],
        )
    ],
}


@pytest.mark.parametrize("kind", LONG)
def test_a_day_is_checked_in_little_time(kind: str) -> None:
    """Processor time, generous: a look at every instant of a day takes minutes."""
    began = time.process_time()
    demand = demand_of(experiment(LONG[kind]))
    assert demand.duration > 0.8 * DAY
    wide = np.full(2, 20.0)
    assert excesses(demand, low=-wide, high=wide, speed=wide, acceleration=np.full(2, 1e4)) == []
    assert time.process_time() - began < 5.0


def test_an_excess_of_a_moment_late_in_a_day_is_found() -> None:
    day = [*LONG["repeat"], dict(type="chirp", joint=2, amplitude=0.9, frequency=1.0, to_frequency=1.1, duration=2.0)]
    demand = demand_of(experiment([*day, dict(type="hold", duration=DAY)]))
    [high] = excesses(demand, high=np.array([9.0, 0.6]))
    assert (high.kind, high.joint) == (Kind.HIGH, 2) and 0.6 < high.value < 0.7
    drifting = [
        dict(type="repeat", times=80000, segment=[dict(type="drive", joint=1, by=1e-5), dict(type="hold", duration=1)])
    ]
    [drift] = excesses(demand_of(experiment(drifting)), high=np.array([0.5, 9.0]))
    assert drift.joint == 1 and drift.value == pytest.approx(0.9, abs=1e-9)


def test_the_furthest_of_a_million_seconds_is_found_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every block goes further beyond the limit than the one before it: few of the 300 000 are looked at."""
    looks: list[int] = []
    look = excess._looked_at

    def counted(demand: Any, first: int, last: int) -> Any:
        looks.append(first)
        return look(demand, first, last)

    monkeypatch.setattr(excess, "_looked_at", counted)
    [far] = excesses(demand_of(experiment([dict(type="drive", joint=1, by=1e6)])), high=np.array([0.5, 9.0]))
    assert far.joint == 1 and far.value == pytest.approx(1e6, rel=1e-6) and len(looks) < 100


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        (
            [dict(type="repeat", times=10**9, segment=[dict(type="hold", duration=1.0)])],
            "file: lasts 1.157e.04 days; at most 31",
        ),
        ([dict(type="repeat", times=2**63, segment=[dict(type="drive", joint=1, by=0.1)])], "lasts"),
        ([dict(type="hold", duration=1e15)], "lasts"),
        ([dict(type="hold", duration=1e300)], "finite number"),
        ([dict(type="drive", joint=1, to=1e15)], "lasts"),
    ],
)
def test_what_lasts_for_ever_is_refused_at_once(segments: list[dict[str, Any]], words: str) -> None:
    table = dict(name="test", start=START, full_speed=[1.0, 2.0], full_acceleration=[5.0, 8.0], segment=segments)
    with pytest.raises(InputError, match=words):
        experiment_of(table, "file")


def test_repeats_that_stand_in_one_another_too_deep_are_refused() -> None:
    segments = [dict(type="drive", joint=1, by=1e-6)]
    for depth in range(8):
        segments = [dict(type="repeat", times=2, segment=segments)]
        if depth < 5:
            experiment(segments)
    with pytest.raises(InputError, match="repeats are nested more than 5 deep"):
        experiment_of(
            dict(name="x", start=START, full_speed=[1, 1], full_acceleration=[1, 1], segment=segments), "file"
        )


def test_a_thousand_million_times_is_expanded_nowhere() -> None:
    """In a process of its own, whose memory is bounded: 1e9 passes of a microsecond are a quarter of an hour."""
    code = """
import numpy as np
from experiment import Experiment, demand_of
from experiment.excess import excesses
inner = [dict(type="hold", duration=1e-6)]
motion = Experiment.model_validate(dict(name="x", start=[0.0], full_speed=[1.0], full_acceleration=[1.0],
    segment=[dict(type="repeat", times=10**9, segment=inner), dict(type="drive", joint=1, by=1.0)]))
def most():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
before = most()
demand = demand_of(motion)
assert abs(demand.duration - 1002.0) < 1.0
assert not excesses(demand, high=np.array([1.1]), speed=np.array([1.1])) and excesses(demand, high=np.array([0.9]))
assert most() - before < 100_000
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
