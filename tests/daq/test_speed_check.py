"""Speed as the guard sees it, on motions known in closed form, with gaps, repeated values and values that came late."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daq.rig.speed_check import SpeedCheck

PERIOD = 10_000_000  # ns
LIMIT = np.array([1.0])
UNITS = ["rad"] * 8


def seen(check: SpeedCheck, q: np.ndarray, measured: np.ndarray, timed: np.ndarray, sizes: list[int]) -> str | None:
    """What is said of the rows when they come in blocks of these sizes."""
    host = 10**18 + np.arange(len(q), dtype=np.int64) * PERIOD
    edges = np.clip(np.cumsum([0, *sizes, len(q)]), 0, len(q))
    for start, stop in pairwise(edges):
        rows = slice(int(start), int(stop))
        if stop > start:
            breach = check.too_fast(q[rows, None], measured[rows, None], timed[rows, None], host[rows])
            if breach:
                return breach
    return None


SIZES = st.lists(st.integers(1, 30), max_size=60)
GAPS = st.lists(
    st.tuples(st.integers(0, 480), st.integers(1, 95), st.sampled_from(["missing", "stale", "late"])), max_size=6
)


@given(sizes=SIZES, gaps=GAPS, speed=st.floats(-0.99, 0.99), turn=st.integers(50, 450))
def test_no_gap_makes_a_joint_look_fast(
    sizes: list[int], gaps: list[tuple[int, int, str]], speed: float, turn: int
) -> None:
    """A joint that goes back and forth below its limit; values are missing, repeated, or come up to 0.95 s late."""
    t = np.arange(500) * PERIOD * 1e-9
    true = speed * np.where(t < turn * 0.01, t, 2 * turn * 0.01 - t)
    q, measured, timed = true.copy(), np.ones(500, bool), np.ones(500, bool)
    for start, length, kind in gaps:
        rows = slice(start, start + length)
        timed[rows] = False
        if kind == "missing":
            measured[rows] = False
            q[rows] = np.nan
        else:
            q[rows] = true[start] if kind == "stale" else true[max(start - length, 0)]
    # Where gaps lie on one another nothing of known time is left for longer than the check waits: another matter.
    runs = np.diff(np.flatnonzero(np.concatenate([[True], timed, [True]])))
    if runs.max() * PERIOD < 1_000_000_000:
        assert seen(SpeedCheck(LIMIT, PERIOD, UNITS), q, measured, timed, sizes) is None


@given(sizes=SIZES, speed=st.floats(1.01, 50.0), sign=st.sampled_from([-1, 1]))
def test_a_fast_joint_is_seen_within_five_rows(sizes: list[int], speed: float, sign: int) -> None:
    q = sign * speed * np.arange(7) * PERIOD * 1e-9
    here = np.ones(7, bool)
    breach = seen(SpeedCheck(LIMIT, PERIOD, UNITS), q, here, here, sizes)
    assert breach == f"joint 1 at {speed:.4g} rad/s, limit 1 rad/s"


@given(sizes=SIZES)
def test_a_device_that_is_always_late_is_still_watched(sizes: list[int]) -> None:
    q = 1.5 * np.arange(400) * PERIOD * 1e-9
    timed = np.zeros(400, bool)
    timed[0] = True
    assert (
        seen(SpeedCheck(LIMIT, PERIOD, UNITS), q, np.ones(400, bool), timed, sizes)
        == "joint 1 at 1.5 rad/s, limit 1 rad/s"
    )


def test_a_new_run_begins_anew() -> None:
    check = SpeedCheck(LIMIT, PERIOD, UNITS)
    here = np.ones((7, 1), bool)
    host = 10**18 + np.arange(7, dtype=np.int64) * PERIOD
    assert check.too_fast(np.zeros((7, 1)), here, here, host) is None
    assert check.too_fast(np.ones((7, 1)), here, here, host) is None
