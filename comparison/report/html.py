"""compare.html: one file that opens anywhere, without a network."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import arm_report
from arm_report import image, note, page, table, warning
from comparison.change import Change
from comparison.report import plots
from comparison.report.wording import changed_sentences, percent, size, verdict

if TYPE_CHECKING:
    from comparison.outcome import Comparison

READING = (
    "2 std is two joint standard deviations: root of the sum of both sides' variances, with the scatter between the "
    "recordings of a group. <i>z</i> is the change over one of them. <i>p corrected</i> is the probability of such a "
    "change by chance, corrected for the number of quantities (Benjamini and Hochberg): of all changes with at most "
    "0.05, one in twenty is expected to be false. Grey: not significant."
)
CURVES = (
    "Torque that opposes motion, identified at a few speeds per joint and direction together with links and rotors, "
    "and with no assumption about its shape. Bars: two standard deviations."
)
FRICTION = (
    "Coulomb and viscous friction are level at zero speed and slope of the friction curve, by the same least squares "
    "on both sides."
)


def report(result: Comparison) -> str:
    """The whole page."""
    changed = changed_sentences(result)
    figure = plots.curves(result)
    body = [
        note(escape(_what(result))),
        arm_report.verdict(verdict(result), refuted=bool(result.significant)),
        *_list(result.causes),
        *_list(changed),
        "<h2>What differs in the recordings themselves</h2>" if result.circumstances else "",
        *(warning(one.sentence) for one in result.circumstances),
        "<h2>Changes</h2>",
        image(plots.overview(result), "change over joint deviation of every parameter"),
        *(
            ["<h2>Friction against speed</h2>", note(CURVES), image(figure, "friction curves before and after")]
            if figure is not None
            else []
        ),
        "<h2>Every parameter</h2>",
        note(READING + (f" {FRICTION}" if result.what == "recordings" else "")),
        _changes([one for one in result.changes if one.comparable and one.quantity.kind != "curve"]),
        _curve_table(result),
        _not_comparable([one for one in result.changes if not one.comparable]),
        *map(warning, result.warnings),
    ]
    name = "" if result.arm is None else f"{result.arm.name}: "
    return page(f"{name}what changed", body)


def _what(result: Comparison) -> str:
    before, after = (", ".join(Path(path).name for path in side) for side in (result.before, result.after))
    return f"Before: {before}. After: {after}. Compared: {result.what}."


def _list(sentences: list[str]) -> list[str]:
    return ["<ul>", *(f"<li>{escape(one)}</li>" for one in sentences), "</ul>"] if sentences else []


def _changes(changes: list[Change]) -> str:
    scattered = any(one.scatter is not None for one in changes)
    head = ["quantity", "before", "after", "change", "2 std", "relative", "z", "p corrected", "unit"]
    head += ["scatter"] if scattered else []
    rows = []
    for one in changes:
        row = [
            f"{escape(one.quantity.words)}<br><small>{escape(one.quantity.name)}</small>",
            size(one.before),
            size(one.after),
            size(one.change),
            "" if one.std is None else f"{2 * one.std:.2g}",
            percent(one).replace("+-", "±"),
            "" if one.z is None else f"{one.z:+.1f}",
            "" if one.corrected is None else f"{one.corrected:.2g}",
            f"<span class=u>{escape(one.quantity.unit)}</span>",
        ]
        rows.append(row + ([size(one.scatter)] if scattered else []))
    weak = [k for k, one in enumerate(changes) if not one.significant]
    return table(rows, head, [*range(1, 8), 9], weak)


def _curve_table(result: Comparison) -> str:
    points = [one for one in result.changes if one.quantity.kind == "curve" and one.comparable]
    if not points:
        return ""
    return f"<details><summary>Every point of the friction curves</summary>{_changes(points)}</details>"


def _not_comparable(changes: list[Change]) -> str:
    if not changes:
        return ""
    rows = [[escape(one.quantity.words), escape(one.quantity.why)] for one in changes]
    return f"<h2>Not comparable</h2>{table(rows, ('quantity', 'reason'))}"
