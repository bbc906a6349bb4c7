"""A chart as data: one description for all that draws it.

In a page uPlot does, in print ``arm_report.stills``, in pictures for papers ``arm_report.paper``.

Axis labels are "quantity, unit". Colours are of ``arm_report.palette``; joints count from 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from arm_io.types import Array
from arm_report.palette import AXIS, NOISE


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """Values y (k,) over x (k,); NaN breaks a line.

    label   in the legend, which shows each once; "" keeps it out
    kind    bars: from zero to x, at the rows y of ``Panel.names``; both: a line with dots
    two_std  (k,) two standard deviations: a band about a line, bars at dots; None: none
    joint   whose values they are, where several joints share a panel
    at      (k,) s on the time axis of ``Panel.motion``: when a dot was measured; None: x is that time, or none is
    """

    x: Array
    y: Array
    colour: str
    label: str = ""
    kind: Literal["line", "dots", "both", "bars"] = "line"
    width: float = 0.8
    dashed: bool = False
    hollow: bool = False
    two_std: Array | None = None
    joint: int | None = None
    at: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Zone:
    """A range of an axis that is shaded, such as what instruments alone explain."""

    low: float
    high: float
    axis: Literal["x", "y"] = "y"
    colour: str = NOISE
    label: str = ""


@dataclass(frozen=True, kw_only=True)
class Level:
    """A straight line at one value of an axis, with words beside it if it has any."""

    value: float
    axis: Literal["x", "y"] = "y"
    colour: str = AXIS
    label: str = ""
    dashed: bool = False
    words: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """One pair of axes.

    y_range  shown while nothing is zoomed; None: that of the values
    x_range  the same of the other axis
    joint    whose values they are; None: several joints', or no joint's
    motion   the clip of ``Motion`` that was recorded meanwhile; "": none
    dates    x is in s since 1970 UTC
    equal    one unit is as long on both axes
    names    of the rows of bars, from the top
    linear   the x axis is linear up to this value and logarithmic beyond; None: linear throughout
    """

    series: tuple[Series, ...]
    x: str
    y: str
    title: str = ""
    zones: tuple[Zone, ...] = ()
    levels: tuple[Level, ...] = ()
    log_x: bool = False
    log_y: bool = False
    y_range: tuple[float, float] | None = None
    x_range: tuple[float, float] | None = None
    joint: int | None = None
    motion: str = ""
    dates: bool = False
    equal: bool = False
    names: tuple[str, ...] = ()
    linear: float | None = None

    @property
    def whole(self) -> bool:
        """Whether every x is a whole number, such as that of a row: then the ticks are, too."""
        return all(bool(np.all(np.isnan(one.x) | (one.x % 1.0 == 0.0))) for one in self.series)


@dataclass(frozen=True, kw_only=True, eq=False)
class Chart:
    """Panels in rows of ``columns``.

    name    of its picture: letters, digits and underscores
    title   what it shows, in words
    shared  panels of a column have one x axis and are zoomed together
    height  of a row on paper, inches
    widths  of the columns, relative
    """

    name: str
    title: str
    panels: tuple[Panel, ...]
    columns: int = 1
    shared: bool = False
    height: float = 2.6
    widths: tuple[float, ...] = field(default=())


LEAST_RANGE = 4.0
"""Std: half of the least range of a chart of values over their noise."""


def robust_range(values: Array, room: float = 1.15) -> tuple[float, float]:
    """A range about zero that holds 99 % of the values, in units of their std, and ``LEAST_RANGE`` either way."""
    sizes = np.abs(values[np.isfinite(values)])
    top = max(LEAST_RANGE, room * float(np.quantile(sizes, 0.99))) if len(sizes) else LEAST_RANGE
    return -top, top
