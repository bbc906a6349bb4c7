"""The age of what is read is estimated from the stream's pace alone; the test's wire knows it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.stream_age import StreamAge

FASTEST = 23_040.0  # bytes/s
POLL = 5_000_000  # ns


def play(delays: list[float], pace: float, quick: int = 200) -> np.ndarray:
    """(n, 2) s: the true delay of the newest byte, in order of arrival, and the estimated one.

    ``quick`` readings without delay come first.
    """
    estimated, true, age, taken = [], [], StreamAge(FASTEST), 0
    sent = 0.0  # s: when the newest byte that is here was sent
    for k, delay in enumerate([0.0] * quick + delays):
        now = (k + 1) * POLL
        sent = max(sent, now * 1e-9 - delay)  # a line keeps the order
        count = int(sent * pace)
        estimated.append(age.read(now, count - taken) * 1e-9)
        true.append(now * 1e-9 - sent)
        taken = count
    return np.stack([true, estimated], axis=1)[quick:]


@given(delays=st.lists(st.floats(0.0, 0.08), min_size=1, max_size=60), slower=st.sampled_from([1.0, 0.9999, 0.97, 0.6]))
@settings(max_examples=200)
def test_the_delay_is_known_from_the_count(delays: list[float], slower: float) -> None:
    true, estimated = play(delays, slower * FASTEST).T
    assert np.abs(estimated - true).max() < 0.001 + 0.05 * true.max()


@pytest.mark.parametrize("slower", [1.0001, 1.0, 0.9999, 0.8])
def test_a_stream_that_is_never_held_up_is_never_old(slower: float) -> None:
    _, estimated = play([0.0] * 4000, slower * FASTEST, quick=40).T
    assert estimated.max() < 0.001


def test_a_line_that_stays_slow_stays_old() -> None:
    """All bytes 30 ms late for 3 s, the pace as ever: only the count shows it."""
    true, estimated = play([0.03] * 600, FASTEST)[6:].T
    assert true.min() > 0.029 and estimated.min() > 0.02


def test_a_beginning_that_was_held_up_is_forgiven_when_a_quicker_byte_comes() -> None:
    age, now = StreamAge(FASTEST), 0
    age.read(0, 0)
    for count in [115] * 60 + [700]:  # the last: 25 ms that had waited somewhere from the first byte on
        now += POLL
        assert age.read(now, count) == 0.0
    assert age.read(now + POLL, 0) == POLL
