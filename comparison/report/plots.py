"""The pictures of a comparison: change over joint deviation of every quantity, friction curves before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arm_report.palette import AFTER, AXIS, BEFORE, GRID, MEASURED, NOISE
from comparison.change import Change

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from comparison.outcome import Comparison

MOST = 60
"""Bars; of more, those with the largest changes."""


def overview(result: Comparison) -> Figure:
    """Change over joint deviation, one bar per parameter; grey: not significant."""
    from matplotlib.figure import Figure

    tested = [one for one in result.changes if one.z is not None and one.comparable and one.quantity.kind != "curve"]
    kept = sorted(tested, key=lambda one: -abs(one.z or 0.0))[:MOST]
    shown = [one for one in tested if one in kept]
    figure = Figure(figsize=(10.5, 1.2 + 0.22 * max(len(shown), 1)), layout="constrained")
    axis = figure.subplots()
    axis.axvspan(-2, 2, color=NOISE, zorder=0)
    axis.axvline(0.0, color=AXIS, lw=0.8)
    sizes = [one.z or 0.0 for one in shown]
    axis.barh(range(len(shown)), sizes, color=[AFTER if one.significant else MEASURED for one in shown])
    labels = [one.quantity.words for one in shown]
    axis.set_yticks(range(len(shown)), [label if len(label) < 48 else f"{label[:45]}..." for label in labels])
    axis.tick_params(axis="y", labelsize="small")
    axis.invert_yaxis()
    if sizes and max(map(abs, sizes)) > 20:
        axis.set_xscale("symlog", linthresh=5)
    axis.grid(axis="x", color=GRID)
    axis.set_axisbelow(True)
    axis.set_xlabel("change / joint deviation; blue: significant, band: two deviations")
    return figure


def curves(result: Comparison) -> Figure | None:
    """Friction torque against speed, per joint, before and after, with two standard deviations; None without any."""
    from matplotlib.figure import Figure

    points = [one for one in result.changes if one.quantity.kind == "curve" and one.comparable]
    joints = sorted({one.quantity.joint for one in points if one.quantity.joint is not None})
    if not joints:
        return None
    columns = min(3, len(joints))
    rows = -(-len(joints) // columns)
    figure = Figure(figsize=(3.5 * columns, 2.6 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis, joint in zip(axes, joints):
        _curve(axis, joint, [one for one in points if one.quantity.joint == joint])
    for axis in axes[len(joints) :]:
        axis.set_visible(False)
    axes[0].legend(fontsize="small")
    return figure


def _curve(axis: Axes, joint: int, points: list[Change]) -> None:
    per = "rad/s" if points[0].quantity.unit == "N m" else "m/s"
    for sign in (1.0, -1.0):
        mine = [one for one in points if (one.quantity.speed or 0.0) * sign > 0]
        mine.sort(key=lambda one: one.quantity.speed or 0.0)
        speed = [one.quantity.speed or 0.0 for one in mine]
        for side, colour in (("before", BEFORE), ("after", AFTER)):
            values = [sign * float(getattr(one, side)) for one in mine]
            std = [2 * float(getattr(one, f"std_{side}")) for one in mine]
            label = side if sign > 0 else None
            axis.errorbar(speed, values, std, color=colour, marker=".", lw=1.0, capsize=2, label=label)
    axis.axhline(0.0, color=AXIS, lw=0.6)
    axis.axvline(0.0, color=AXIS, lw=0.6)
    axis.grid(color=GRID)
    axis.set_title(f"joint {joint}", loc="left", fontsize="small")
    axis.set_xlabel(per, fontsize="small")
    axis.set_ylabel(f"friction, {points[0].quantity.unit}", fontsize="small")
