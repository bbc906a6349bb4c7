"""A late answer to one SYNC never passes for the answer to the next."""

from __future__ import annotations

import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cia406.protocol import Rounds

PERIOD = 2_000_000  # ns
LATEST = 0.01  # s: five periods


def play(delays: list[float | None]) -> list[tuple[int, int | None]]:
    """Rounds of one node whose k-th answer comes so many periods after its SYNC (None: never).

    (number of the SYNC, its value).
    """
    rounds, under_way, got, sent = Rounds((3,), LATEST), [], [], 0
    for tick in range(3 * len(delays)):
        begun, ended = tick * PERIOD, (tick + 1) * PERIOD
        for at, value in [f for f in under_way if f[0] < begun]:
            rounds.take(3, struct.pack("<I", value), at)
        under_way = [f for f in under_way if f[0] >= begun]
        if sent == len(delays) or rounds.blocked(begun):
            rounds.skip()
            continue
        rounds.begin(begun)
        if delays[sent] is not None:
            under_way.append((begun + 1 + int(delays[sent] * PERIOD), sent))
        for at, value in [f for f in under_way if f[0] < ended]:
            rounds.take(3, struct.pack("<I", value), at)
        under_way = [f for f in under_way if f[0] >= ended]
        rounds.end()
        got.append((sent, rounds.nodes[3].value))
        sent += 1
    return got


@given(delays=st.lists(st.one_of(st.none(), st.floats(0.0, 4.5)), min_size=1, max_size=40))
@settings(max_examples=200)
def test_no_value_of_another_round(delays: list[float | None]) -> None:
    got = play(delays)
    assert all(value is None or value == sent for sent, value in got)


def test_one_lost_answer_costs_one_pause_and_no_more() -> None:
    got = play([0.1] * 5 + [None] + [0.1] * 20)
    assert [sent for sent, value in got if value is None] == [5]


def test_a_frame_sent_before_the_sync_is_not_its_answer() -> None:
    rounds = Rounds((1, 2), LATEST)
    rounds.begin(1000)
    rounds.take(1, struct.pack("<I", 77), 999)
    assert rounds.nodes[1].value is None and not rounds.complete
    rounds.take(1, struct.pack("<I", 78), 1001)
    rounds.take(2, b"short", 1001)
    rounds.take(2, struct.pack("<I", 5), 1002)
    assert rounds.complete and rounds.nodes[1].value == 78
    rounds.take(1, struct.pack("<I", 79), 1003)
    assert rounds.nodes[1].doubtful and not rounds.nodes[2].doubtful


def test_a_node_that_is_absent_holds_nobody_up_and_is_heard_again_after_a_pause() -> None:
    rounds, now = Rounds((1,), LATEST), 0
    while not (rounds.nodes[1].silent >= 10):
        if not rounds.blocked(now):
            rounds.begin(now)
            rounds.end()
        now += PERIOD
    assert not rounds.blocked(now)
    rounds.begin(now)
    assert rounds.complete
    rounds.take(1, struct.pack("<I", 1), now + 5)
    assert rounds.nodes[1].value is None and rounds.blocked(now + PERIOD)
    now += int(LATEST * 1e9) + 10
    assert not rounds.blocked(now)
    rounds.begin(now)
    rounds.take(1, struct.pack("<I", 2), now + 5)
    assert rounds.nodes[1].value == 2
