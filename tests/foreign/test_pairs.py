"""Two hidden effects are two: neither may stand for the other, and each is where it may be."""

from __future__ import annotations

from tests.foreign.cases import cases
from tests.foreign.hide import places
from tests.foreign.pairs import ONE_SPRING, pairs
from tests.foreign.score import SAME


def test_pairs_are_the_single_effects_of_a_seed_with_another_one() -> None:
    drawn = list(pairs(51605, 60))
    assert [pair.first.name for pair in drawn] == [case.name for case in cases("first", "singles", 51605, 60)]
    assert len({pair.name for pair in drawn}) == 60
    for pair in drawn:
        one, other = pair.first, pair.second
        assert other.arm is one.arm and other.logger is one.logger and other.key != one.key
        assert other.effect is not None and other.joint in places(other.effect, other.arm)
        assert one.effect != other.effect
        assert not any({one.effect, other.effect} <= same for same in (*SAME, ONE_SPRING))
