"""docs/diagnosis-evidence.md: the figures that the page begins with are the sums of its tables of first runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGE = "docs/diagnosis-evidence.md"
SUMMARY = "In short"
KINDS = ("singles", "weak", "pairs", "triples")


def _table(text: str, after: str) -> list[list[str]]:
    """The cells of the first table behind the line that begins with ``after``; its head first."""
    lines = text[re.search(rf"^[#*]+ ?{re.escape(after)}", text, re.M).end() :].splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith("|"))
    count = next(number for number, line in enumerate(lines[first:]) if not line.startswith("|"))
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[first : first + count]]
    return [cells[0], *cells[2:]]


def _counts(cells: list[str]) -> tuple[int, int]:
    """The sum of all "A of B"."""
    pairs = [(int(a), int(b)) for cell in cells for a, b in re.findall(r"(\d+) of (\d+)", cell)]
    return sum(a for a, _ in pairs), sum(b for _, b in pairs)


@pytest.mark.parametrize(
    ("row", "section"),
    [("first generator, later first runs", "Later first runs"), ("second generator, all first runs", "First runs")],
)
def test_the_summary_is_the_sum_of_the_first_runs(root: Path, row: str, section: str) -> None:
    text = (root / PAGE).read_text(encoding="utf-8")
    stated = next(cells for cells in _table(text, SUMMARY) if cells[0].startswith(row))
    head, *runs = _table(text, section)
    column = {name: [cells[head.index(name)] for cells in runs] for name in head}

    assert [f"{a} of {b}" for a, b in (_counts(column[kind]) for kind in KINDS)] == stated[1:5]

    superfluous = [re.match(r"([\d.]+) \((\d+)\)", cell) for cell in column["superfluous"]]
    names = sum(float(found[1]) * int(found[2]) for found in superfluous if found)
    cases = sum(int(found[2]) for found in superfluous if found)
    assert float(stated[5]) == pytest.approx(names / cases, abs=0.006)

    nothing = column["nothing hidden: named; `unexplained`"]
    named, healthy = _counts(nothing)
    unexplained = sum(int(found[1]) for cell in nothing if (found := re.search(r"; (\d+)$", cell)))
    assert stated[6] == f"{named + unexplained} of {healthy}"
