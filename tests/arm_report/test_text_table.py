"""Tables of text keep their numbers and their columns, however narrow the line."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from arm_report import text_table

word = st.text("abcdefgh", min_size=1, max_size=30)
size = st.integers(-(10**9), 10**9).map(str)


@given(rows=st.lists(st.tuples(word, size, word, size), min_size=1, max_size=5), width=st.integers(20, 120))
def test_numbers_are_never_cut_and_columns_line_up(rows: list[tuple[str, str, str, str]], width: int) -> None:
    lines = text_table(rows, ("name", "a", "words", "b"), numbers=(1, 3), shorten=(0, 2), width=width)
    found = [line.split() for line in lines[1:]]
    assert [(one[1], one[3]) for one in found] == [(row[1], row[3]) for row in rows]
    assert len({len(line) for line in lines}) == 1
    narrowest = sum(max(len(row[k]) for row in rows) for k in (1, 3)) + 6 + 6 + 6 + 2
    assert len(lines[0]) <= max(width, narrowest)
    for one, row in zip(found, rows):
        for k in (0, 2):
            assert one[k] == row[k] or (one[k].endswith("...") and row[k].startswith(one[k][:-3]))
