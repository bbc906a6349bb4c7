"""Tables of text keep their numbers and their columns, however narrow the line."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from arm_report import cut, text_table

word = st.text("abcdefgh", min_size=1, max_size=30)
size = st.integers(-(10**9), 10**9).map(str)
HEAD = ("name", "a", "words", "b", "unit")


@given(rows=st.lists(st.tuples(word, size, word, size, word), min_size=1, max_size=5), width=st.integers(45, 120))
def test_a_table_continues_below_itself_by_whole_columns(rows: list[tuple[str, ...]], width: int) -> None:
    lines = text_table(rows, HEAD, numbers=(1, 3), shorten=(0, 2, 4), keep=(0, 4), width=width)
    assert max(map(len, lines)) <= width
    found: dict[str, list[str]] = {}
    while lines:
        part = lines[: 1 + len(rows)]
        lines = lines[2 + len(rows) :]
        assert part[0].split()[0] == "name" and part[0].split()[-1] == "unit"
        for k, head in enumerate(part[0].split()):
            found[head] = [line.split()[k] for line in part[1:]]
    assert set(found) == set(HEAD)
    for k, head in enumerate(HEAD):
        for one, row in zip(found[head], rows):
            assert one == row[k] or (k not in (1, 3) and one.endswith("...") and row[k].startswith(one[:-3]))


@given(name=st.text("ab0123456789.+ ", min_size=1, max_size=40), width=st.integers(6, 40))
def test_a_number_in_a_shortened_cell_is_whole_or_left_out(name: str, width: int) -> None:
    shown = cut(name, width)
    assert len(shown) <= width
    if shown != name:
        kept = shown.removesuffix("...")
        assert name.startswith(kept)
        numbers = set("0123456789.")
        assert not kept or not (kept[-1] in numbers and name[len(kept)] in numbers)


def test_a_table_of_whole_lines_is_whole_in_a_pipe_and_keeps_what_can_be_read_in_a_terminal() -> None:
    """Arms read "Uni..." and verdicts "exp..." in a terminal of 80 columns, and in a pipe, where they are searched."""
    verdict, path = "explained: load friction of joint 2", "results/2026-11/worn/diagnosis/diagnosis.json"
    rows = [("Unimation Puma 560", "1", verdict, "2", path)]
    (_, shown) = text_table(rows, HEAD, numbers=(1, 3), shorten=(0, 2), keep=None, width=80)
    assert shown.split("  ")[0] == "Unimation Pum..." and "explained: lo..." in shown and shown.endswith(path)
    (_, piped) = text_table(rows, HEAD, numbers=(1, 3), shorten=(0, 2), keep=None)
    assert all(cell in piped for cell in rows[0])
