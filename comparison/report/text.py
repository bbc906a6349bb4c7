"""A comparison as text: what ``armscope compare`` prints, and ``print(result)`` in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arm_report import cut, line_width, text_table
from comparison.change import Change
from comparison.report.wording import changed_sentences, overruled_sentences, percent, size, two_std, verdict
from comparison.wording import probability

if TYPE_CHECKING:
    from comparison.outcome import Comparison

WIDEST = 56
"""Letters of a quantity; longer ones stand whole in the report."""
HEADS = ("quantity", "before", "after", "change", "2 std", "relative", "z", "p corr.", "unit")
LEGEND = (
    "*: significant; z: change over its std; p corr.: probability by chance, corrected for the number of quantities"
)
OVERRULED = (
    "\N{DEGREE SIGN}: significant by single recordings, but the consequence of another change: the reason is below"
)
MOST = 12
"""Rows of the table that are printed; all stand in the report."""


def text(result: Comparison) -> str:
    """The circumstances, a table of the largest changes, the significant ones in words, and the verdict."""
    lines = [
        f"note: {one}"
        for one in (*(circumstance.sentence for circumstance in result.circumstances), *result.assumptions)
    ]
    tested = [change for change in result.changes if change.corrected is not None and change.quantity.kind != "curve"]
    tested.sort(key=lambda one: -abs(one.z or 0.0))
    shown = tested[: max(MOST, sum(one.significant for one in tested))]
    lines += _table(shown)
    if any(one.significant for one in shown):
        lines.append(LEGEND)
    if any(one.overruled for one in shown):
        lines.append(OVERRULED)
    if len(tested) > len(shown):
        lines.append(f"... and {len(tested) - len(shown)} more parameters with smaller changes")
    blind = [change for change in result.changes if not change.comparable]
    reasons: dict[str, int] = {}
    for one in blind:
        reasons[one.quantity.why] = reasons.get(one.quantity.why, 0) + 1
    lines += [f"not comparable: {count} quantit{'y' if count == 1 else 'ies'}: {why}" for why, count in reasons.items()]
    lines += [f"warning: {warning}" for warning in result.warnings]
    in_short = verdict(result)
    sentences = [*result.causes, *(summary.sentence for summary in result.summaries), *changed_sentences(result)]
    sentences += overruled_sentences(result)
    return "\n".join([*lines, *(sentence for sentence in sentences if sentence not in in_short), in_short])


def _table(changes: list[Change]) -> list[str]:
    last = len(HEADS) - 1
    return text_table([_row(change) for change in changes], HEADS, numbers=range(1, last), keep=(0, last))


def _row(change: Change) -> tuple[str, ...]:
    mark = "*" if change.significant else "\N{DEGREE SIGN}" if change.overruled else ""
    return (
        _in_width(change.quantity.words, min(WIDEST, line_width() - 30)),
        *(size(value, change.std) for value in (change.before, change.after)),
        size(change.change, change.std, sign="+"),
        two_std(change),
        percent(change),
        "" if change.z is None else f"{change.z:+z.1f}{mark}",
        "" if change.corrected is None else probability(change.corrected),
        change.quantity.unit,
    )


def _in_width(words: str, width: int) -> str:
    """The words of a quantity in so many letters; of a sum, how many more parameters it has stays: "(3 more)"."""
    first, sum_of, others = words.partition(" (with ")
    if len(words) <= width or not sum_of:
        return cut(words, width)
    count = f" ({others.split()[0]} more)"
    return cut(first, width - len(count)) + count
