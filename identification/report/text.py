"""An identification as text: what ``armscope identify`` prints, and ``print(result)`` in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from arm_report import text_table
from arm_report.numbers import shortened, value_and_two_std
from identification.report import friction, ripples
from identification.report.html import verdict

if TYPE_CHECKING:
    from identification.result import Identification, Value

HEADS = ("value", "2 std", "unit", "")


def text(result: Identification) -> str:
    """Parameters that these runs determine, sums that only appear together, friction, warnings, and the verdict.

    Deviations of other kinds (bootstrap, formula) stand in the report and in identification.json.
    """
    base = {value.name for value in result.base}
    listed = [value for value in result.parameters if value.std is not None and ".curve" not in value.name]
    names = {value.name for value in listed}
    sums = [value for value in result.base if value.name not in names and ".curve" not in value.name]
    lines = _table(listed, "parameter")
    if sums and base:
        lines += _table(sums, "combination")
    lines += [*friction.in_short(result), *ripples.sentences(result)]
    if lag := result.extra.get("lag_of_currents"):
        lines.append(lag["says"])
    lines += [f"warning: {warning}" for warning in result.warnings]
    return "\n".join([*lines, verdict(result)])


def _table(values: Sequence[Value], what: str) -> list[str]:
    return text_table([_row(one) for one in values], (what, *HEADS), numbers=(1, 2), shorten=(0,))


def _row(value: Value) -> tuple[str, ...]:
    return (
        shortened(value.name),
        *value_and_two_std(value.value, value.std),
        value.unit,
        "" if value.identifiable else "not identifiable here",
    )
