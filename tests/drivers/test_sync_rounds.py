"""A late answer to one SYNC never passes for the answer to the next."""

from __future__ import annotations

import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cia406_protocol import Rounds

PERIOD = 2_000_000  # ns


@given(delays=st.lists(st.floats(0.0, 3.9), min_size=1, max_size=40))
@settings(max_examples=200, deadline=None)
def test_no_value_of_another_round(delays: list[float]) -> None:
    """Answers in order, each late by up to four periods; the value says which round it belongs to."""
    arrivals: list[tuple[int, int]] = []
    free = 0
    for k, delay in enumerate(delays):
        free = max(free, int((k + delay) * PERIOD) + 1)
        arrivals.append((free, k))
    rounds = Rounds((3,))
    for k in range(len(delays)):
        begun, ended = k * PERIOD, (k + 1) * PERIOD
        rounds.begin(begun)
        for at, value in arrivals:
            if begun <= at < ended:
                rounds.take(3, struct.pack("<I", value), at)
        rounds.end()
        value_now = rounds.nodes[3].value
        assert value_now is None or value_now == k


def test_a_frame_sent_before_the_sync_is_not_its_answer() -> None:
    rounds = Rounds((1, 2))
    rounds.begin(1000)
    rounds.take(1, struct.pack("<I", 77), 999)
    assert rounds.nodes[1].value is None and not rounds.complete
    rounds.take(1, struct.pack("<I", 78), 1001)
    rounds.take(2, b"short", 1001)
    rounds.take(2, struct.pack("<I", 5), 1002)
    assert rounds.complete and rounds.nodes[1].value == 78


def test_a_debt_is_forgiven_and_two_answers_are_doubtful() -> None:
    rounds = Rounds((1,))
    rounds.begin(0)
    rounds.end()
    rounds.begin(200_000_000)
    rounds.take(1, struct.pack("<I", 1), 200_000_001)
    assert rounds.nodes[1].value == 1
    rounds.take(1, struct.pack("<I", 2), 200_000_002)
    assert rounds.nodes[1].doubtful
