"""An identification as text: what ``armscope identify`` prints, and ``print(result)`` in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from identification.report.friction import sentences
from identification.report.html import verdict

if TYPE_CHECKING:
    from identification.result import Identification, Value

WIDEST = 60
"""Characters of a name; longer sums are cut, and stand whole in the report."""
HEADS = ("value", "2 std", "(bootstrap)", "(formula)")


def text(result: Identification) -> str:
    """Parameters that these runs determine, sums that only appear together, friction, warnings, and the verdict."""
    base = {value.name for value in result.base}
    named = [value for value in result.parameters if value.std is not None and ".curve" not in value.name]
    names = {value.name for value in named}
    sums = [value for value in result.base if value.name not in names and ".curve" not in value.name]
    lines = _table(named, "parameter")
    if sums and base:
        lines += _table(sums, "combination")
    lines += sentences(result)
    lines += [f"warning: {warning}" for warning in result.warnings]
    return "\n".join([*lines, verdict(result)])


def _table(values: Sequence[Value], what: str) -> list[str]:
    rows = [(what, *HEADS, "unit", ""), *map(_row, values)]
    width = [max(len(row[column]) for row in rows) for column in range(7)]
    return [
        "  ".join(
            cell.rjust(width[column]) if 1 <= column <= 4 else cell.ljust(width[column])
            for column, cell in enumerate(row)
        ).rstrip()
        for row in rows
    ]


def _row(value: Value) -> tuple[str, ...]:
    name = value.name if len(value.name) <= WIDEST else f"{value.name[: WIDEST - 3]}..."
    stds = (value.std, value.std_bootstrap, value.std_formula)
    spreads = ("" if std is None else f"{2 * std:.2g}" for std in stds)
    return name, f"{value.value:.5g}", *spreads, value.unit, "" if value.identifiable else "not identifiable here"
