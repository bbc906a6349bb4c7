"""Changes in sentences."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from arm_report.numbers import value_and_two_std
from comparison.change import SIGNIFICANT, Change

if TYPE_CHECKING:
    from comparison.outcome import Comparison


def size(value: float | None, std: float | None, *, sign: str = "") -> str:
    """A value to the second digit of two standard deviations, those of the change; nothing for None."""
    return "" if value is None else value_and_two_std(value, std, sign=sign)[0]


def two_std(change: Change) -> str:
    """Two standard deviations of the change; nothing where none are known."""
    return value_and_two_std(0.0, change.std)[1]


def percent(change: Change) -> str:
    """'+49 % +- 4 %', two standard deviations; nothing where the value before is not clearly other than zero."""
    if change.relative is None:
        return ""
    value, std = change.relative
    digits = max(0, 1 - int(np.floor(np.log10(max(200 * std, 1e-3)))))
    return f"{100 * value:+z.{digits}f} % +- {200 * std:.{digits}f} %"


def sentence(change: Change) -> str:
    """'Coulomb friction of joint 3: 5.1 -> 7.6 N m, +49 % +- 4 % (z = 28)'."""
    words = change.quantity.words[:1].upper() + change.quantity.words[1:]
    unit = f" {change.quantity.unit}" if change.quantity.unit not in ("", "1") else ""
    share = f", {percent(change)}" if change.relative is not None else ""
    z = "" if change.z is None else f" (z = {change.z:+z.1f})"
    before, after = (size(value, change.std) for value in (change.before, change.after))
    return f"{words}: {before} -> {after}{unit}{share}{z}"


def curve_sentence(joint: int, points: list[Change]) -> str:
    """What the significant points of a joint's friction curve say together; ``points`` are all of that joint."""
    changed = [point for point in points if point.significant]
    sizes = [change.change for change in changed if change.change is not None]
    speeds = [abs(change.quantity.speed or 0.0) for change in changed]
    unit = changed[0].quantity.unit
    per = "rad/s" if unit == "N m" else "m/s"
    where = "all compared speeds" if len(changed) == len(points) else f"{len(changed)} of {len(points)} compared points"
    range_ = f"{min(speeds):.2g} {per}" if len(speeds) == 1 else f"{min(speeds):.2g} to {max(speeds):.2g} {per}"
    low, high = min(sizes), max(sizes)
    by = f"{low:+.3g} {unit}" if len(sizes) == 1 else f"{low:+.3g} to {high:+.3g} {unit}"
    return f"Friction curve of joint {joint}: changed at {where} ({range_}) by {by}"


def curve_sentences(result: Comparison) -> list[str]:
    """One per joint whose friction curve changed anywhere."""
    sentences = []
    curves = [change.quantity for change in result.changes if change.quantity.kind == "curve"]
    joints = sorted({quantity.joint for quantity in curves if quantity.joint is not None})
    for joint in joints:
        points = [
            change
            for change in result.changes
            if change.quantity.kind == "curve" and change.quantity.joint == joint and change.comparable
        ]
        if any(point.significant for point in points):
            sentences.append(curve_sentence(joint, points))
    return sentences


def changed_sentences(result: Comparison) -> list[str]:
    """One per significant parameter, surest first, then one per friction curve."""
    parameters = [sentence(one) for one in result.significant if one.quantity.kind != "curve"]
    return parameters + curve_sentences(result)


def overruled_sentences(result: Comparison) -> list[str]:
    """What single recordings call changed and all of them together do not, with the reason; one per reason."""
    by_reason: dict[str, list[str]] = {}
    for one in result.changes:
        if one.overruled and one.z is not None and one.quantity.kind != "curve":
            by_reason.setdefault(one.overruled, []).append(f"{one.quantity.words} (z = {one.z:+.1f})")
    return [f"{reason[:1].upper()}{reason[1:]}: {', '.join(names)}" for reason, names in by_reason.items()]


def verdict(result: Comparison) -> str:
    """What changed, in one sentence; and in another what the recordings do not distinguish from it."""
    changes = _what_changed(result)
    return f"{changes} Not distinguished: {'; '.join(result.alternatives)}." if result.alternatives else changes


def _what_changed(result: Comparison) -> str:
    if not result.tested:
        reasons = Counter(change.quantity.why for change in result.changes if change.quantity.why)
        return (
            f"Nothing could be compared: {reasons.most_common(1)[0][0]}." if reasons else "Nothing could be compared."
        )
    share = f"at most {SIGNIFICANT:.0%} of such findings are false"
    if not result.significant:
        return f"No significant change of {result.tested} compared quantities ({share})."
    if result.summaries:
        words = "; ".join(summary.sentence for summary in result.summaries)
        explained = {name for one in result.summaries for name in one.explains}
        if left := sum(one.quantity.name not in explained for one in result.significant):
            return f"{words}; {left} are left unexplained; {result.tested} quantities compared ({share})."
        return f"{words}; nothing else of {result.tested} compared quantities ({share})."
    parameters = [one for one in result.significant if one.quantity.kind != "curve"]
    rubbing = {parameter.quantity.joint for parameter in parameters if parameter.quantity.kind == "friction"}
    curves = {one.quantity.joint for one in result.significant if one.quantity.kind == "curve"} - rubbing
    first = sentence(parameters[0]) if parameters else curve_sentences(result)[0]
    more = len(parameters) + len(curves) - 1
    others = f"; and {more} more" if more else "; nothing else"
    return f"{first}{others} of {result.tested} compared quantities ({share})."
