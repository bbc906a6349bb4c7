"""The figures that the two pages of evidence begin with are the sums of their tables of first runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGE = "docs/diagnosis-evidence.md"
FOREIGN = "docs/foreign-arms.md"
SUMMARY = "In short"
KINDS = ("singles", "weak", "pairs", "triples")


def _table(text: str, after: str) -> list[list[str]]:
    """The cells of the first table behind the line that begins with ``after``; its head first."""
    found = re.search(rf"^[#*]* ?{re.escape(after)}", text, re.M)
    assert found is not None, after
    lines = text[found.end() :].splitlines()
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


@pytest.mark.parametrize(
    ("row", "section", "first"),
    [
        ("the model is given, all seeds", "First protocol", "401"),
        ("the model is given, from seed 9996 on", "First protocol", "9996"),
        ("the model is identified, all seeds", "Second protocol", "401"),
        ("the model is identified, from seed 9952 on", "Second protocol", "9952"),
        ("`compare` of both days, from seed 9952 on", "`compare` of both days", "9952"),
    ],
)
def test_the_summary_of_foreign_arms_is_the_sum_of_its_tables(root: Path, row: str, section: str, first: str) -> None:
    text = (root / FOREIGN).read_text(encoding="utf-8")
    stated = next(cells for cells in _table(text, SUMMARY) if cells[0].startswith(row))
    _, *runs = _table(text, section)
    seeds = [cells[0].split()[0].rstrip(",") for cells in runs]
    runs = runs[seeds.index(first) :]
    cases, named = [_leading(cells[2]) for cells in runs], [_leading(cells[3]) for cells in runs]
    assert stated[1] == f"{sum(named)} of {sum(cases)}"
    assert stated[3] == "{} of {}".format(*_counts([cells[-1] for cells in runs]))
    if stated[2]:
        counted = [(n, float(cells[4])) for n, cells in zip(cases, runs) if re.fullmatch(r"[\d.]+", cells[4])]
        mean = sum(n * each for n, each in counted) / sum(n for n, _ in counted)
        assert float(stated[2]) == pytest.approx(mean, abs=0.006)
    else:
        assert f"`diagnose` named {sum(_leading(cells[5]) for cells in runs)}" in stated[0]


def _leading(cell: str) -> int:
    """The number that a cell begins with; 0 if none."""
    found = re.match(r"\d+", cell)
    return int(found[0]) if found else 0
