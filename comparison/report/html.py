"""compare.html: one file that opens anywhere, without a network."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from arm_report import Report, table
from arm_report.numbers import shortened, typeset
from comparison.change import Change, Quantity
from comparison.report import plots
from comparison.report.wording import changed_sentences, overruled_sentences, percent, size, two_std, verdict
from comparison.wording import probability

if TYPE_CHECKING:
    from comparison.outcome import Comparison


def report(result: Comparison) -> Report:
    """The whole page."""
    says = verdict(result)
    points = [change for change in result.changes if change.quantity.kind == "curve" and change.comparable]
    name = "" if result.arm is None else f"{result.arm.name}: "
    return Report(
        title=f"{name}what changed",
        template="comparison.report/compare.html",
        joints=[] if result.arm is None else [joint.name for joint in result.arm.joints],
        content={
            "what": _what(result),
            "says": says,
            "changed": bool(result.significant),
            "causes": result.causes,
            "changed_sentences": [one for one in changed_sentences(result) if one not in says],
            "overruled": overruled_sentences(result),
            "circumstances": [circumstance.sentence for circumstance in result.circumstances],
            "assumptions": result.assumptions,
            "overview": plots.overview(result),
            "curves": plots.curves(result),
            "of_recordings": result.what == "recordings",
            "changes": _changes(
                [change for change in result.changes if change.comparable and change.quantity.kind != "curve"]
            ),
            "curve_points": _changes(points) if points else None,
            "not_comparable": [
                [change.quantity.words, change.quantity.why] for change in result.changes if not change.comparable
            ],
            "warnings": result.warnings,
        },
    )


def quantity_cell(quantity: Quantity) -> Markup:
    """A quantity in words over its parameter; of a long sum the first terms, the whole where the pointer rests."""
    name = Markup('<small title="{}">{}</small>').format(quantity.name, shortened(quantity.name))
    return Markup("{}<br>{}").format(quantity.words, name)


def _what(result: Comparison) -> str:
    names = shortest([*result.before, *result.after])
    before, after = (", ".join(side) for side in (names[: len(result.before)], names[len(result.before) :]))
    return f"Before: {before}. After: {after}. Compared: {result.what}."


def shortest(paths: Sequence[str]) -> list[str]:
    """The names of files; where two are the same, their paths below the folder that all are in."""
    names = [Path(path).name for path in paths]
    if len(set(names)) == len(names):
        return names
    common = Path(os.path.commonpath([Path(path).absolute().parent for path in paths]))
    return [str(Path(path).absolute().relative_to(common)) for path in paths]


def _changes(changes: list[Change]) -> Markup:
    scattered = any(change.scatter is not None for change in changes)
    head = ["quantity", "before", "after", "change", "2 std", "relative", "z", "p corrected", "unit"]
    head += ["scatter"] if scattered else []
    rows = []
    for one in changes:
        row: list[str] = [
            quantity_cell(one.quantity),
            *(size(value, one.std) for value in (one.before, one.after)),
            size(one.change, one.std, sign="+"),
            two_std(one),
            typeset(percent(one)),
            "" if one.z is None else f"{one.z:+z.1f}",
            "" if one.corrected is None else probability(one.corrected),
            Markup('<span class="u">{}</span>').format(one.quantity.unit),
        ]
        rows.append(row + (["" if one.scatter is None else f"{one.scatter:.2g}"] if scattered else []))
    weak = [k for k, one in enumerate(changes) if not one.significant]
    return table(rows, head, [*range(1, 8), 9], weak)
