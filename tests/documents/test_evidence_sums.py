"""The tables that both pages of evidence begin with are the sums of the logs of first runs, judged by their goals."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

EVIDENCE, BLIND = "docs/diagnosis-evidence.md", "docs/first-runs-blind.md"
FOREIGN, FOREIGN_RUNS = "docs/foreign-arms.md", "docs/first-runs-foreign.md"
KINDS = {
    "one effect": "singles",
    "one weak effect": "weak",
    "two effects": "pairs",
    "three effects": "triples",
}


SUMMED = pytest.mark.parametrize(
    ("column", "generator", "newest"),
    [(2, "First generator", None), (3, "Second generator", None), (4, "Second generator", 10)],
)
"""The columns of the summary, and how many seeds of the log each is of; None: all."""


def _table(root: Path, page: str, after: str) -> list[list[str]]:
    """The cells of the first table of a page behind the line that begins with ``after``; its head first."""
    text = (root / page).read_text(encoding="utf-8")
    found = re.search(rf"^[#*]* ?{re.escape(after)}", text, re.M)
    assert found is not None, after
    lines = text[found.end() :].splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith("|"))
    count = next(number for number, line in enumerate(lines[first:]) if not line.startswith("|"))
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[first : first + count]]
    return [cells[0], *cells[2:]]


def _row(rows: list[list[str]], begin: str) -> list[str]:
    """The row whose first cell begins with these words."""
    return next(cells for cells in rows if cells[0].startswith(begin))


def _counts(cells: list[str]) -> tuple[int, int]:
    """The sum of all "A of B"."""
    pairs = [(int(a), int(b)) for cell in cells for a, b in re.findall(r"(\d+) of (\d+)", cell)]
    return sum(a for a, _ in pairs), sum(b for _, b in pairs)


def _judged(goal: str, cell: str) -> str:
    """What a figure is by its goal: "98 %" at least, "93 to 97 %" between, "0 %", "0.03" at most, "0 of 200" cases."""
    figure = _counts([cell])
    if "." in goal:
        return "met" if float(cell.split(",")[0]) <= float(goal) else "missed"
    if (asked := re.fullmatch(r"0 of (\d+)", goal)) is not None:
        return "missed" if figure[0] else "met" if figure[1] >= int(asked[1]) else "open"
    low, high = (re.findall(r"\d+", goal) * 2)[:2]
    share = 100 * figure[0] / figure[1]
    if low == high == "0":
        return "met" if share == 0 else "missed"
    return "met" if share >= float(low) and (low == high or share <= float(high)) else "missed"


@pytest.mark.parametrize(("page", "columns"), [(EVIDENCE, (2, 3, 4)), (FOREIGN, (2, 3))])
def test_every_figure_is_judged_by_its_goal(root: Path, page: str, columns: tuple[int, ...]) -> None:
    judged = 0
    for cells in _table(root, page, "In short")[1:]:
        for cell in (cells[column] for column in columns if cells[column] and cells[1] != "as `diagnose`"):
            assert cell.split(", ")[1] == _judged(cells[1], cell), cells
            judged += 1
    assert judged > 10


@SUMMED
def test_the_summary_is_the_sum_of_the_first_runs(root: Path, column: int, generator: str, newest: int | None) -> None:
    stated = {cells[0]: cells[column].split(", ")[0] for cells in _table(root, EVIDENCE, "In short")[1:]}
    head, *runs = _table(root, BLIND, generator)
    runs_of = {name: [cells[head.index(name)] for cells in runs[:newest]] for name in head}

    def said(begin: str) -> str:
        return next(figure for what, figure in stated.items() if what.startswith(begin))

    for what, kind in KINDS.items():
        assert said(what) == "{} of {}".format(*_counts(runs_of[kind])), kind

    superfluous = [re.match(r"([\d.]+) \((\d+)\)", cell) for cell in runs_of["superfluous"]]
    names = sum(float(found[1]) * int(found[2]) for found in superfluous if found)
    cases = sum(int(found[2]) for found in superfluous if found)
    assert float(said("superfluous")) == pytest.approx(names / cases, abs=0.006)

    nothing = runs_of["nothing hidden: named; `unexplained`"]
    named, healthy = _counts(nothing)
    unexplained = sum(int(found[1]) for cell in nothing if (found := re.search(r"; (\d+)$", cell)))
    assert said("nothing") == f"{named + unexplained} of {healthy}"

    outside = runs_of["not in the catalogue: misnamed; `unexplained`; right variable"]
    misnamed, foreign = _counts(outside)
    unexplained = sum(int(found[1]) for cell in outside if (found := re.search(r"; (\d+); \d+$", cell)))
    assert said("an effect outside") == f"{misnamed} of {foreign}"
    assert said("the same") == f"{unexplained} of {foreign}"


@SUMMED
def test_parameters_within_two_std_are_the_sum_of_the_notes(
    root: Path, column: int, generator: str, newest: int | None
) -> None:
    text = (root / BLIND).read_text(encoding="utf-8")
    section = text[re.search(rf"^## {generator}$", text, re.M).end() :]  # type: ignore[union-attr]
    note = re.search(r"^\* Parameters within two std: ([^.]*)", section, re.M)
    assert note is not None
    stated = _row(_table(root, EVIDENCE, "In short"), "parameters")[column]
    seeds = [part for part in note[1].split(", ") if _counts([part])[1]]
    assert stated.split(", ")[0] == "{} of {}".format(*_counts(seeds[-newest:] if newest else seeds))


@pytest.mark.parametrize(
    ("what", "column", "section", "oldest"),
    [
        ("the model is given", 2, "First protocol", "401"),
        ("the model is given", 3, "First protocol", "9996"),
        ("the model is identified", 2, "Second protocol", "401"),
        ("the model is identified", 3, "Second protocol", "9952"),
        ("`compare`", 3, "`compare` of both days", "9952"),
    ],
)
def test_the_summary_of_foreign_arms_is_the_sum_of_its_log(
    root: Path, what: str, column: int, section: str, oldest: str
) -> None:
    stated = [cells for cells in _table(root, FOREIGN, "In short") if cells[0].startswith(what)]
    _, *runs = _table(root, FOREIGN_RUNS, section)
    seeds = [cells[0].split()[0].rstrip(",") for cells in runs]
    runs = runs[: seeds.index(oldest) + 1]
    cases, named = [_leading(cells[2]) for cells in runs], [_leading(cells[3]) for cells in runs]
    hidden, *superfluous, nothing = (cells[column] for cells in stated)
    assert re.split("[,;]", hidden)[0] == f"{sum(named)} of {sum(cases)}"
    assert nothing.split(", ")[0] == "{} of {}".format(*_counts([cells[-1] for cells in runs]))
    if superfluous:
        counted = [(n, float(cells[4])) for n, cells in zip(cases, runs) if re.fullmatch(r"[\d.]+", cells[4])]
        mean = sum(n * each for n, each in counted) / sum(n for n, _ in counted)
        assert float(superfluous[0].split(", ")[0]) == pytest.approx(mean, abs=0.006)
    else:
        diagnosed = sum(_leading(cells[5]) for cells in runs)
        assert hidden.endswith(f"`diagnose` {diagnosed}, {'met' if sum(named) >= diagnosed else 'missed'}")


def test_all_random_arms_and_their_crashes_are_counted(root: Path) -> None:
    """The table of the page has the arms of the log, and as many with a crash."""
    _, *stated = _table(root, FOREIGN, "Random arms")
    _, *runs = _table(root, FOREIGN_RUNS, "Random arms")
    assert sum(int(cells[2]) for cells in stated) == sum(int(cells[2]) for cells in runs)
    assert sum(_leading(cells[3]) for cells in stated) == sum(_leading(cells[3]) for cells in runs)


def _leading(cell: str) -> int:
    """The number that a cell begins with; 0 if none."""
    found = re.match(r"\d+", cell)
    return int(found[0]) if found else 0
