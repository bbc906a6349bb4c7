"""Charts and motions as JSON for the scripts of a page: few points, numbers in two or four bytes, each array once."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_report.chart import Chart, Panel, Series
from arm_report.envelope import POINTS, envelope, extremes, rows_per_bucket
from arm_report.motion import Motion
from arm_report.palette import DARK

Table = dict[str, Any]
MOST_DATA = 1_500_000
"""Characters: with pictures for print (``stills.MOST_STILLS``), scripts and tables a page stays below 3 MB."""
LEAST_POINTS = 200
"""Points that a chart keeps in any case: a curve over the width of a page."""
LEVELS = 65_534
"""Steps of a quantised array over its range; 65535 is NaN."""


class Arrays:
    """The numbers of a page; the same array twice is stored once."""

    def __init__(self) -> None:
        self.stored: list[Table] = []
        self._known: dict[tuple[str, bytes], int] = {}

    def put(self, values: Array, *, exact: bool = False) -> int:
        """The number of the array; exact: four bytes per value, else steps of 1/65534 of the range."""
        values = np.asarray(values, float)
        key = (f"{len(values)} {exact}", values.tobytes())
        if key not in self._known:
            self._known[key] = len(self.stored)
            self.stored.append(_exact(values) if exact else _quantised(values))
        return self._known[key]


def _exact(values: Array) -> Table:
    """Offsets from the first value, so that four bytes suffice for a time."""
    finite = values[np.isfinite(values)]
    first = float(finite[0]) if len(finite) else 0.0
    return {"first": first, "f32": _base64((values - first).astype("<f4"))}


def _quantised(values: Array) -> Table:
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    step = (high - low) / LEVELS
    scaled = np.full(len(values), LEVELS + 1.0)
    there = np.isfinite(values)
    scaled[there] = np.rint((values[there] - low) / step) if step > 0 else 0.0
    return {"low": low, "step": step, "u16": _base64(scaled.astype("<u2"))}


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()


def page_data(charts: list[Chart], motion: Motion | None, names: list[str]) -> tuple[str, int]:
    """``plain_page`` as text of at most about ``MOST_DATA`` characters, and the points per series that this allows."""
    points = POINTS
    while True:
        text = json.dumps(plain_page(charts, motion, names, points), separators=(",", ":"))
        if len(text) <= MOST_DATA or points <= LEAST_POINTS:
            return text, points
        points = max(LEAST_POINTS, int(0.95 * points * MOST_DATA / len(text)))


def plain_page(charts: list[Chart], motion: Motion | None, names: list[str], points: int = POINTS) -> Table:
    """All that the scripts of a page need; ``names`` of the joints, from the first."""
    arrays = Arrays()
    table: Table = {
        "charts": [_chart(chart, arrays, points) for chart in charts],
        "joints": names,
        "motion": None if motion is None else _motion(motion, arrays),
        "dark": DARK,
    }
    return table | {"arrays": arrays.stored}


def thinned(chart: Chart, points: int = POINTS) -> int:
    """Rows per drawn pair of minimum and maximum in a page, the largest of all series; 1: all rows are drawn."""
    return max((rows_per_bucket(len(one.y), points) for panel in chart.panels for one in panel.series), default=1)


def _chart(chart: Chart, arrays: Arrays, points: int) -> Table:
    return {
        "name": chart.name,
        "title": chart.title,
        "columns": chart.columns,
        "widths": list(chart.widths),
        "shared": chart.shared,
        "height": chart.height,
        "panels": [_panel(panel, arrays, points) for panel in chart.panels],
    }


def _panel(panel: Panel, arrays: Arrays, points: int) -> Table:
    return {
        "x": panel.x,
        "y": panel.y.replace("\n", " "),
        "title": panel.title,
        "zones": [vars(one) for one in panel.zones],
        "levels": [vars(one) for one in panel.levels],
        "log_x": panel.log_x,
        "log_y": panel.log_y,
        "y_range": panel.y_range,
        "x_range": panel.x_range,
        "joint": panel.joint,
        "motion": panel.motion,
        "dates": panel.dates,
        "equal": panel.equal,
        "names": panel.names,
        "linear": panel.linear,
        "whole": panel.whole,
        "series": [_series(one, panel, arrays, points) for one in panel.series if len(one.y)],
    }


def _series(one: Series, panel: Panel, arrays: Arrays, points: int) -> Table:
    bucket = rows_per_bucket(len(one.y), points)
    if one.kind == "line":
        kept, y = envelope(one.y, bucket)
    else:
        # dots keep their exact positions
        kept = extremes(one.y, bucket)
        y = one.y[kept]
    in_order = one.kind == "line"
    table = {
        "x": arrays.put(one.x[kept], exact=in_order or panel.log_x or panel.dates),
        "y": arrays.put(y, exact=panel.log_y),
        "two_std": None if one.two_std is None else arrays.put(one.two_std[kept]),
        "at": None if one.at is None else arrays.put(one.at[kept], exact=True),
    }
    words = {name: getattr(one, name) for name in ("label", "colour", "kind", "width", "dashed", "hollow", "joint")}
    return table | words


def _motion(motion: Motion, arrays: Arrays) -> Table:
    clips = {
        name: {
            "name": clip.name,
            "x": clip.x,
            "t": arrays.put(clip.t, exact=True),
            "q": [arrays.put(column) for column in clip.q.T],
            "pose": None if clip.pose is None else [arrays.put(column) for column in clip.pose.T],
        }
        for name, clip in motion.clips.items()
        if len(clip.t)
    }
    return {"arm": dict(motion.arm), "clips": clips}
