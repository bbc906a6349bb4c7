"""Charts as files for papers (``--png``, ``--pdf``), by matplotlib."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from arm_report.chart import Chart, Panel, Series
from arm_report.notebook import drawing
from arm_report.palette import GRID
from arm_report.scales import Scale, written

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 10.5
"""Inches."""
PICTURE_DPI = 200
TICKS = 12
"""On an axis that is linear about zero and logarithmic beyond."""


def figure(chart: Chart) -> Figure:
    """The whole chart, all points of it."""
    rows = -(-len(chart.panels) // chart.columns)
    drawn = drawing(WIDTH, 0.5 + chart.height * rows)
    widths = chart.widths or (1.0,) * chart.columns
    shared: Literal["col", "none"] = "col" if chart.shared else "none"
    grid = drawn.subplots(rows, chart.columns, squeeze=False, sharex=shared, width_ratios=widths)
    legend = any(map(_named, chart.panels))
    for place, (axis, panel) in enumerate(zip(grid.ravel(), chart.panels)):
        _draw(axis, panel)
        if chart.shared and place < len(chart.panels) - chart.columns:
            axis.set_xlabel("")
            axis.tick_params(labelbottom=False)
    for axis in grid.ravel()[len(chart.panels) :]:
        axis.set_axis_off()
    if legend:
        marks = {text: mark for axis in grid.ravel() for mark, text in zip(*axis.get_legend_handles_labels())}
        drawn.legend(
            list(marks.values()), list(marks), loc="outside upper right", ncols=min(len(marks), 6), fontsize="small"
        )
    return drawn


def _named(panel: Panel) -> bool:
    """Whether the legend has something to say about a panel."""
    labels = [one.label for one in panel.series] + [one.label for one in panel.zones]
    return any(labels) or any(one.label for one in panel.levels)


def _draw(axis: Axes, panel: Panel) -> None:
    if panel.y_range is not None and panel.y_range[0] < panel.y_range[1]:
        # before anything is drawn: on a logarithmic axis the range of equal values is empty
        axis.set_ylim(*panel.y_range)
    for zone in panel.zones:
        span = axis.axhspan if zone.axis == "y" else axis.axvspan
        span(zone.low, zone.high, color=zone.colour, lw=0.0, label=zone.label or None, zorder=0)
    for one in panel.series:
        _series(axis, one, panel.dates)
    if panel.names:
        axis.set_yticks(range(len(panel.names)), panel.names, fontsize="small")
        axis.invert_yaxis()
    _scales(axis, panel)
    axis.grid(color=GRID)
    axis.set_axisbelow(True)
    axis.set_title(panel.title, loc="left", fontsize="medium")
    axis.set_xlabel("" if panel.dates else panel.x)
    axis.set_ylabel(panel.y, fontsize="small")
    if panel.x_range is not None and panel.x_range[0] < panel.x_range[1]:
        axis.set_xlim(*(_dates(np.array(panel.x_range)) if panel.dates else panel.x_range))
    if panel.equal:
        axis.set_aspect("equal", "datalim")
    if panel.dates:
        _date_axis(axis)
    for level in panel.levels:
        line = axis.axhline if level.axis == "y" else axis.axvline
        style = "--" if level.dashed else "-"
        line(level.value, color=level.colour, lw=0.8, ls=style, label=level.label or None, zorder=1.5)
        if level.words and level.axis == "x":
            top = axis.get_xaxis_transform()
            # inside the panel, as its title stands above
            axis.text(level.value, 0.98, f" {level.words}", transform=top, fontsize="small", va="top")
    _ticks(axis, panel)


def _scales(axis: Axes, panel: Panel) -> None:
    """Those that are not linear throughout."""
    if panel.linear is not None:
        axis.set_xscale("symlog", linthresh=panel.linear)
    if panel.log_x:
        axis.set_xscale("log")
    if panel.log_y:
        shown = np.concatenate([np.ravel(np.asarray(one.y, float)) for one in panel.series] or [np.zeros(0)])
        shown = shown[np.isfinite(shown) & (shown > 0.0)]
        if not len(shown):
            return
        if shown.min() == shown.max():
            # matplotlib's own limits about a single power of ten are equal
            axis.set_ylim(shown[0] / 10.0, shown[0] * 10.0)
        axis.set_yscale("log", nonpositive="mask")


def _ticks(axis: Axes, panel: Panel) -> None:
    """Plain numbers on those axes, as on the page, where matplotlib writes powers of ten."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter, NullLocator

    if panel.x == "row":
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    if panel.linear is not None:
        low, high = axis.get_xlim()
        ticks = Scale(low=low, high=high, linear=panel.linear).ticks(TICKS)
        axis.set_xticks(*zip(*ticks))
        axis.xaxis.set_minor_locator(NullLocator())
    for log, one in ((panel.log_x, axis.xaxis), (panel.log_y, axis.yaxis)):
        if log:
            one.set_major_formatter(FuncFormatter(lambda x, _: written(x)))
            one.set_minor_formatter(NullFormatter())


def _series(axis: Axes, one: Series, dates: bool) -> None:
    x: Any = _dates(one.x) if dates else one.x
    y = one.y
    label = one.label or None
    if one.kind == "bars":
        axis.barh(y, x, color=one.colour, label=label)
        return
    style: dict[str, Any] = {"color": one.colour, "label": label}
    if one.kind != "dots":
        style |= {"lw": one.width, "ls": "--" if one.dashed else "-"}
    if one.kind != "line":
        size = 1.6 if len(y) > 100 else 4.0
        style |= {"marker": "o", "ms": size, "mew": 0.0 if size < 2 else 0.8}
        style |= {"mfc": "none"} if one.hollow else {}
    if one.kind == "dots":
        style |= {"ls": "none"}
    if one.two_std is not None and one.kind != "line":
        axis.errorbar(x, y, one.two_std, capsize=2, elinewidth=0.8, **style)
        return
    axis.plot(x, y, **style)
    if one.two_std is not None:
        axis.fill_between(x, y - one.two_std, y + one.two_std, color=one.colour, alpha=0.25, lw=0)


def _dates(seconds: Any) -> list[datetime]:
    return [datetime.fromtimestamp(float(one), UTC) for one in seconds]


def _date_axis(axis: Axes) -> None:
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(minticks=3, maxticks=8)
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(ConciseDateFormatter(locator))
