"""Long lines are broken between words; numbers keep their units, and no letter is lost."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arm_model.effects import CATALOGUE
from arm_report import wrapped

UNITS = sorted({p.unit for effect in CATALOGUE.values() for p in effect.parameters})


@given(words=st.lists(st.text("abc./-12", min_size=1, max_size=25), min_size=1, max_size=40), width=st.integers(30, 90))
def test_no_letter_is_lost_and_no_word_broken(words: list[str], width: int) -> None:
    lines = wrapped("  " + " ".join(words), width).split("\n")
    assert " ".join(line.strip() for line in lines).split() == words
    assert all(len(line) <= width for line in lines)


@pytest.mark.parametrize("unit", UNITS)
def test_a_value_its_deviation_and_its_unit_stay_together(unit: str) -> None:
    value = f"0.00123 +- 0.0004 {unit}".strip()
    for before in range(1, 40):
        text = f"{'x' * before} half_gap {value}, and what follows it until the line is long"
        assert any(value in line for line in wrapped(text, 45).split("\n")), (before, unit)


def test_in_a_pipe_lines_stay_whole(capsys: pytest.CaptureFixture[str]) -> None:
    assert wrapped("word " * 100) == "word " * 100
