"""An identification as text: what ``armscope identify`` prints, and ``print(result)`` in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from arm_report import cut, line_width, text_table
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
    return text_table([_row(one) for one in values], (what, *HEADS, "unit", ""), numbers=range(1, 5), keep=(0, 5))


def _row(value: Value) -> tuple[str, ...]:
    stds = (value.std, value.std_bootstrap, value.std_formula)
    spreads = ("" if std is None else f"{2 * std:.2g}" for std in stds)
    return (
        cut(value.name, min(WIDEST, line_width() - 30)),
        f"{value.value:.5g}",
        *spreads,
        value.unit,
        "" if value.identifiable else "not identifiable here",
    )
