"""A trend in sentences and as a table of text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arm_report import text_table
from arm_report.numbers import value_and_two_std, with_two_std
from comparison.change import SIGNIFICANT
from comparison.trend.forecast import Reach, State
from comparison.trend.history import Histories
from comparison.trend.movement import MONTH, Movement, Onset
from comparison.wording import probability

if TYPE_CHECKING:
    from comparison.trend.outcome import Trend

DOUBTFUL = 0.01
"""p-value of a shape, below which it is said."""
HEADS = ("quantity", "first", "last", "change", "2 std", "since", "p corr.", "unit")


def text(trend: Trend) -> str:
    """A table of what moved, a sentence about each, the limits, and the verdict."""
    moved = trend.moved
    lines = text_table(
        [_row(one, trend.histories) for one in moved], HEADS, numbers=range(1, 7), shorten=(0,), keep=(0, 7)
    )
    lines = lines if moved else []
    lines += [f"warning: {warning}" for warning in trend.histories.warnings]
    lines += [sentence(one, trend.histories) for one in moved]
    lines += [limit_sentence(one, its, trend.histories) for one in trend.limited for its in one.reaches]
    return "\n".join([*lines, verdict(trend)])


def _row(one: Movement, histories: Histories) -> tuple[str, ...]:
    quantity = one.moved.history.quantity
    return (
        quantity.name,
        value_and_two_std(*one.first)[0],
        value_and_two_std(*one.last)[0],
        *value_and_two_std(*one.change, sign="+"),
        histories.date(one.onsets[0].by) or "",
        probability(one.moved.corrected),
        quantity.unit,
    )


def verdict(trend: Trend) -> str:
    """The one sentence."""
    count, results = len(trend.movements), len(trend.histories.results)
    share = f"at most {SIGNIFICANT:.0%} of such findings are expected to be false"
    if not trend.moved:
        return f"No quantity changed significantly: {count} quantities in {results} results ({share})."
    names = ", ".join(one.moved.history.quantity.words for one in trend.moved[:3])
    more = f" and {len(trend.moved) - 3} more" if len(trend.moved) > 3 else ""
    return f"{names}{more} changed; {len(trend.moved)} of {count} quantities in {results} results ({share})."


def sentence(one: Movement, histories: Histories) -> str:
    """'Coulomb friction of joint 3: 6.9 -> 9.8 N m; drifts by +0.5 +- 0.1 N m per 30 days since 2026-03 ...'."""
    quantity = one.moved.history.quantity
    words = quantity.words[:1].upper() + quantity.words[1:]
    unit = _unit(one)
    parts = [_onset(onset, unit, histories) for onset in one.onsets]
    if sum(onset.shape == "drift" for onset in one.onsets) > 1 and one.drift is not None:
        parts.append(f"now drifts by {_size(MONTH * one.drift[0], MONTH * one.drift[1])}{unit} per {MONTH:.0f} days")
    if one.moved.p_shape < DOUBTFUL:
        chances = f"p = {probability(one.moved.p_shape)}"
        parts.append(
            f"its results scatter about this shape more than those of other quantities ({chances}): the shape may be "
            "wrong"
        )
    return f"{words}: {level(*one.first)} -> {level(*one.last)}{unit}; {'; '.join(parts)}"


def level(value: float, std: float) -> str:
    """To the second digit of its two std."""
    return value_and_two_std(value, std)[0]


def _onset(onset: Onset, unit: str, histories: Histories) -> str:
    after, by = histories.date(onset.after), histories.date(onset.by)
    between = f"on {by}" if after == by else f"between {after} and {by}"
    if onset.shape == "step":
        return f"step of {_size(onset.value, onset.std)}{unit} {between}"
    # One that began before the first result is the same straight line.
    since = f"since {by} at the latest" if onset.after <= 0 else f"since a day {between}"
    return f"drift of {_size(MONTH * onset.value, MONTH * onset.std)}{unit} per {MONTH:.0f} days, {since}"


def limit_sentence(one: Movement, reach: Reach, histories: Histories) -> str:
    """Where a quantity stands with respect to a limit, when it reaches it, or what the limit lacks."""
    quantity, unit = one.moved.history.quantity, _unit(one)
    words = f"{quantity.words[:1].upper()}{quantity.words[1:]}"
    first, now = level(*one.first), level(*one.last)
    if reach.limit is None:
        share = f"limit {reach.asked.value:+.0%} of the first value"
        zero = f"{with_two_std(*one.first)}{unit}"
        return f"{words}: {share}, which does not differ from zero ({zero}); give an absolute limit"
    value = f"{reach.limit:.4g}"
    if reach.state is State.UNCLEAR:
        return (
            f"{words}: limit {value}{unit} is ambiguous, as it is not above the first value ({first}, now {now}): an "
            f"upper limit is passed since the first result (write {quantity.name}=..{value}), a lower one is not "
            f"reached (write {quantity.name}={value}..)"
        )
    words = f"{words}: {reach.side} limit {value}{unit}"
    if reach.state is State.PASSED_AT_FIRST:
        return f"{words} is passed since the first result ({first}, now {now})"
    if reach.state is State.PASSED:
        return f"{words} is passed (now {now})"
    if reach.day is None or reach.between is None:
        return f"{words} is not reached at the present trend (now {now})"
    early, late = reach.between
    until = "no date" if late is None else histories.date(late)
    between = f"{histories.date(early)} to {until}"
    return f"{words} is reached on {histories.date(reach.day)} at the present drift (95 %: {between})"


def _unit(one: Movement) -> str:
    unit = one.moved.history.quantity.unit
    return f" {unit}" if unit not in ("", "1") else ""


def _size(value: float, std: float) -> str:
    return with_two_std(value, std, sign="+")
