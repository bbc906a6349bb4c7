"""The charts of a comparison: change over joint deviation of every quantity, friction curves before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arm_report import Chart, Level, Panel, Series, Zone
from arm_report.palette import AFTER, BEFORE, MEASURED, PALE_AFTER
from comparison.change import Change

if TYPE_CHECKING:
    from comparison.outcome import Comparison

MOST = 60
"""Bars; of more, those with the largest changes."""
LINEAR = 5.0
"""Deviations up to which the axis is linear, where some changes are far larger."""
KINDS = {"significant": AFTER, "consequence of another change": PALE_AFTER, "not significant": MEASURED}
"""Bars by what they say, with their colours."""


def overview(result: Comparison) -> Chart:
    """Change over joint deviation, one bar per parameter."""
    tested = [
        change
        for change in result.changes
        if change.z is not None and change.comparable and change.quantity.kind != "curve"
    ]
    largest = sorted(tested, key=lambda one: -abs(one.z or 0.0))[:MOST]
    shown = [one for one in tested if one in largest]
    words = [one.quantity.words for one in shown]
    series = []
    for label, colour in KINDS.items():
        rows = [k for k, one in enumerate(shown) if _kind(one) == label]
        sizes = np.array([shown[k].z or 0.0 for k in rows])
        series.append(Series(x=sizes, y=np.array(rows, float), kind="bars", colour=colour, label=label))
    panel = Panel(
        series=tuple(one for one in series if len(one.x)),
        x="change over its std (shaded: two std)",
        y="",
        zones=(Zone(low=-2.0, high=2.0, axis="x"),),
        levels=(Level(value=0.0, axis="x"),),
        names=tuple(text if len(text) < 72 else f"{text[:69]}..." for text in words),
        linear=LINEAR if any(abs(one.z or 0.0) > 20 for one in shown) else None,
    )
    return Chart(
        name="changes",
        title="change of every parameter over its std",
        panels=(panel,),
        height=0.9 + 0.22 * max(len(shown), 1),
    )


def _kind(one: Change) -> str:
    return "significant" if one.significant else "consequence of another change" if one.overruled else "not significant"


def curves(result: Comparison) -> Chart | None:
    """Friction against speed, per joint, before and after, with two standard deviations; None without any."""
    points = [change for change in result.changes if change.quantity.kind == "curve" and change.comparable]
    joints = sorted({point.quantity.joint for point in points if point.quantity.joint is not None})
    if not joints:
        return None
    panels = tuple(_curve(joint, [point for point in points if point.quantity.joint == joint]) for joint in joints)
    return Chart(
        name="friction_curves",
        title="friction against speed, before and after, with two standard deviations",
        panels=panels,
        columns=min(3, len(joints)),
    )


def _curve(joint: int, points: list[Change]) -> Panel:
    unit = points[0].quantity.unit
    per = "rad/s" if unit == "N m" else "m/s"
    series = []
    for sign in (1.0, -1.0):
        one_way = [point for point in points if (point.quantity.speed or 0.0) * sign > 0]
        one_way.sort(key=lambda one: one.quantity.speed or 0.0)
        speed = np.array([one.quantity.speed or 0.0 for one in one_way])
        for side, colour in (("before", BEFORE), ("after", AFTER)):
            values = np.array([sign * float(getattr(one, side)) for one in one_way])
            two_std = np.array([2 * float(getattr(one, f"std_{side}")) for one in one_way])
            series.append(Series(x=speed, y=values, two_std=two_std, kind="both", colour=colour, label=side, width=1.0))
    return Panel(
        series=tuple(series),
        title=f"joint {joint}",
        x=f"speed, {per}",
        y=f"friction, {unit}",
        levels=(Level(value=0.0), Level(value=0.0, axis="x")),
        joint=joint,
    )
