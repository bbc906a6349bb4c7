"""Charts as SVG, for print and in a page that runs no scripts.

A diagnosis has ten charts of seventy panels: matplotlib took a fifth of the whole time of ``armscope diagnose`` to draw
them small, and they could not be read when enlarged (docs/decisions/0038-stills-in-svg.md). Lengths are in px, 72 to
the inch of ``Chart.height``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from markupsafe import Markup, escape

from arm_io.types import Array
from arm_report.chart import Chart, Panel, Series
from arm_report.envelope import extremes, rows_per_bucket
from arm_report.palette import EDGE, GRID
from arm_report.scales import Scale, scale_of

WIDTH, INCH = 756.0, 72.0
FINE = 10
"""Parts of a px in which points are placed: they are whole numbers then."""
MOST_STILLS = 1_000_000
"""Characters of all stills of a page together."""
MOST_DOTS, LEAST_POINTS = 600, 60
"""Points of a cloud; of any series where there is no room for more."""
FONT, LETTER = 9.0, 5.0
"""Height of the letters, and the mean width of one."""
LEFT, RIGHT, TOP, TITLE, BOTTOM, NO_LABEL = 50.0, 8.0, 6.0, 14.0, 30.0, 8.0
"""Margins of a panel; at the top with a title, and at the bottom without the label of a shared axis."""
LEGEND_ROW = 14.0


@dataclass(frozen=True)
class Place:
    """Where the axes of a panel stand, and what they show."""

    left: float
    top: float
    width: float
    height: float
    x: Scale
    y: Scale

    def points(self, x: Array, y: Array) -> Array:
        """(k, 2) values in ``FINE`` parts of a px from the top left corner of the axes; far outside, just outside."""
        shares = np.column_stack([self.x.place(x), 1.0 - self.y.place(y)])
        return np.rint(FINE * np.clip(shares, -9.0, 10.0) * (self.width, self.height))


def stills(charts: Sequence[Chart]) -> list[Markup]:
    """The charts as SVG elements; of fewer points where together they exceed ``MOST_STILLS`` characters."""
    drawn = [still(chart) for chart in charts]
    size = sum(map(len, drawn))
    if size <= MOST_STILLS:
        return drawn
    # axes and text need their room independent of the number of points
    least = sum(len(still(chart, 0.0)) for chart in charts)
    detail = 0.9 * max(MOST_STILLS - least, 0) / max(size - least, 1)
    return [still(chart, detail) for chart in charts]


def still(chart: Chart, detail: float = 1.0) -> Markup:
    """One chart; ``detail``: points drawn, as a share of two per px of a line and ``MOST_DOTS`` per cloud."""
    legend, head = _legend(chart)
    places = list(_places(chart, head))
    rows = -(-len(chart.panels) // chart.columns)
    height = head + INCH * chart.height * rows
    inside = "".join(
        _panel(panel, place, chart, k, detail) for k, (panel, place) in enumerate(zip(chart.panels, places))
    )
    return Markup(
        f'<svg viewBox="0 0 {WIDTH:g} {height:g}" width="{WIDTH:g}" height="{height:g}" role="img" '
        f'aria-label="{escape(chart.title)}" font-family="sans-serif" font-size="{FONT:g}">'
        f'<rect width="100%" height="100%" fill="white"/>{legend}{inside}</svg>'
    )


def _places(chart: Chart, head: float) -> Iterator[Place]:
    """Every panel's axes; those of a column have one x axis where it is shared."""
    scales = [_scales(panel) for panel in chart.panels]
    widths = np.array(chart.widths or (1.0,) * chart.columns)
    edges = np.append(0.0, np.cumsum(widths / widths.sum())) * WIDTH
    for k, (panel, (x, y)) in enumerate(zip(chart.panels, scales)):
        row, column = divmod(k, chart.columns)
        if chart.shared:
            alike = [one for one, _ in scales[column :: chart.columns]]
            x = replace(x, low=min(one.low for one in alike), high=max(one.high for one in alike))
        left = max([LEFT, *(LETTER * len(name) + 8.0 for name in panel.names)])
        top = TITLE if panel.title else TOP
        bottom = BOTTOM if _labelled(chart, k) else NO_LABEL
        width, height = float(edges[column + 1] - edges[column]) - left - RIGHT, INCH * chart.height - top - bottom
        place = Place(float(edges[column]) + left, head + INCH * chart.height * row + top, width, height, x, y)
        yield _equal(place) if panel.equal else place


def _labelled(chart: Chart, k: int) -> bool:
    """Whether the x axis of a panel has words: not above another that shares it."""
    return not chart.shared or k >= len(chart.panels) - chart.columns


def _scales(panel: Panel) -> tuple[Scale, Scale]:
    """Both axes of a panel, as its values and what is marked on it say."""
    marked = {
        axis: [np.array([one.low, one.high]) for one in panel.zones if one.axis == axis]
        + [np.array([one.value]) for one in panel.levels if one.axis == axis]
        for axis in ("x", "y")
    }
    x = scale_of(
        [*(one.x for one in panel.series), *marked["x"], *([np.zeros(1)] if panel.names else [])],
        panel.x_range,
        log=panel.log_x,
        linear=panel.linear,
        dates=panel.dates,
        whole=panel.whole,
    )
    if panel.names:
        return x, Scale(low=len(panel.names) - 0.5, high=-0.5)
    ends = [
        one.y + side * (one.two_std if one.two_std is not None else 0.0) for one in panel.series for side in (-1, 1)
    ]
    return x, scale_of([*ends, *marked["y"]], panel.y_range, log=panel.log_y, linear=None, dates=False)


def _equal(place: Place) -> Place:
    """The same with the range of one axis widened, so that one unit is as long on both."""
    x, y = place.x, place.y
    unit = max((x.high - x.low) / place.width, (y.high - y.low) / place.height)

    def widened(scale: Scale, length: float) -> Scale:
        more = (unit * length - (scale.high - scale.low)) / 2
        return replace(scale, low=scale.low - more, high=scale.high + more)

    return replace(place, x=widened(x, place.width), y=widened(y, place.height))


def _panel(panel: Panel, place: Place, chart: Chart, k: int, detail: float) -> str:
    """Axes with their words, and inside them zones, lines and dots."""
    frame = f'x="{place.left:.1f}" y="{place.top:.1f}" width="{place.width:.1f}" height="{place.height:.1f}"'
    inside = [*_zones(panel, place), *_grid(panel, place)]
    inside += [part for one in panel.series for part in _series(one, place, detail)]
    inside += _levels(panel, place)
    return (
        f'<svg {frame} viewBox="0 0 {FINE * place.width:.0f} {FINE * place.height:.0f}" preserveAspectRatio="none">'
        f'{"".join(inside)}</svg><rect {frame} fill="none" stroke="{EDGE}" stroke-width=".6"/>'
        f"{''.join(_words(panel, place, _labelled(chart, k)))}"
    )


def _grid(panel: Panel, place: Place) -> Iterator[str]:
    width, height = FINE * place.width, FINE * place.height
    across = [f"M{FINE * place.width * float(place.x.place(at)):.0f} 0V{height:.0f}" for at, _ in _x_ticks(place)]
    up = [f"M0 {height * (1.0 - float(place.y.place(at))):.0f}H{width:.0f}" for at, _ in _y_ticks(panel, place)]
    yield _path("".join([*across, *up]), GRID, 0.8)


def _x_ticks(place: Place) -> list[tuple[float, str]]:
    return place.x.ticks(max(2, int(place.width / (75.0 if place.x.dates else 45.0))))


def _y_ticks(panel: Panel, place: Place) -> list[tuple[float, str]]:
    if panel.names:
        return [(float(row), name) for row, name in enumerate(panel.names)]
    return place.y.ticks(max(4, int(place.height / 18.0)))


def _zones(panel: Panel, place: Place) -> Iterator[str]:
    for zone in panel.zones:
        scale, whole = (place.x, place.width) if zone.axis == "x" else (place.y, place.height)
        first, last = np.sort(FINE * whole * np.clip(scale.place(np.array([zone.low, zone.high])), -1.0, 2.0))
        if zone.axis == "x":
            yield f'<rect x="{first:.0f}" width="{last - first:.0f}" height="100%" fill="{zone.colour}"/>'
        else:
            top = FINE * place.height - last
            yield f'<rect y="{top:.0f}" width="100%" height="{last - first:.0f}" fill="{zone.colour}"/>'


def _levels(panel: Panel, place: Place) -> Iterator[str]:
    for level in panel.levels:
        at = float((place.x if level.axis == "x" else place.y).place(level.value))
        if level.axis == "x":
            line = f"M{FINE * place.width * at:.0f} 0V{FINE * place.height:.0f}"
        else:
            line = f"M0 {FINE * place.height * (1.0 - at):.0f}H{FINE * place.width:.0f}"
        yield _path(line, level.colour, 0.8, dashed=level.dashed)


def _series(one: Series, place: Place, detail: float) -> Iterator[str]:
    if one.kind == "bars":
        for x, y in zip(one.x, one.y):
            (left, top), (right, bottom) = place.points(np.sort([0.0, x]), np.array([y - 0.4, y + 0.4]))
            size = f'width="{right - left:.0f}" height="{abs(bottom - top):.0f}"'
            yield f'<rect x="{left:.0f}" y="{min(top, bottom):.0f}" {size} fill="{one.colour}"/>'
        return
    most = MOST_DOTS if one.kind == "dots" else 2.0 * place.width
    kept = extremes(one.y, rows_per_bucket(len(one.y), max(LEAST_POINTS, int(detail * most))))
    x, y = one.x[kept], one.y[kept]
    points = place.points(x, y)
    if one.two_std is not None:
        low, high = (place.points(x, y + side * one.two_std[kept]) for side in (-1.0, 1.0))
        if one.kind == "line":
            both = np.vstack([high, low[::-1]])
            yield f'<path d="{_line(both[np.isfinite(both).all(axis=1)])}z" fill="{one.colour}" opacity=".25"/>'
        else:
            bars = (f"M{a[0]:.0f} {a[1]:.0f}V{b[1]:.0f}" for a, b in zip(low, high) if np.isfinite([*a, *b]).all())
            yield _path("".join(bars), one.colour, 0.8)
    if one.kind != "dots":
        yield _path(_line(points), one.colour, one.width, dashed=one.dashed)
    if one.kind != "line":
        yield from _dots(points, one)


def _dots(points: Array, one: Series) -> Iterator[str]:
    """Dots as lines of no length with round ends; few are larger, and may be hollow."""
    shown = points[np.isfinite(points).all(axis=1)].astype(int)
    path = "".join(f"m{x} {y}h0" for x, y in np.diff(shown, axis=0, prepend=0)).replace(" -", "-")
    size = 1.6 if len(points) > 100 else 4.0
    yield _path(path, one.colour, size, round_ends=True)
    if one.hollow:
        yield _path(path, "white", 0.6 * size, round_ends=True)


def _line(points: Array) -> str:
    """A path through points (k, 2) of whole numbers, interrupted where they are NaN."""
    finite = np.isfinite(points).all(axis=1)
    parts = np.split(points, np.flatnonzero(np.diff(finite)) + 1) if len(points) else []
    found = []
    for part in parts:
        if np.isfinite(part).all():
            steps = np.diff(part.astype(int), axis=0, prepend=0).ravel().tolist()
            found.append(f"M{steps[0]} {steps[1]}l{' '.join(map(str, steps[2:] or (0, 0)))}".replace(" -", "-"))
    return "".join(found)


def _path(line: str, colour: str, width: float, *, dashed: bool = False, round_ends: bool = False) -> str:
    if not line:
        return ""
    style = f' stroke-dasharray="{4 * FINE} {3 * FINE}"' if dashed else ""
    style += ' stroke-linecap="round"' if round_ends else ' stroke-linejoin="round"'
    return f'<path d="{line}" fill="none" stroke="{colour}" stroke-width="{FINE * width:g}"{style}/>'


def _words(panel: Panel, place: Place, labelled: bool) -> Iterator[str]:
    """Values and names at both axes, and what stands above."""
    left, top, bottom = place.left, place.top, place.top + place.height
    for at, text in _x_ticks(place) if labelled else ():
        yield _text(left + place.width * float(place.x.place(at)), bottom + FONT + 2.0, text, "middle")
    for at, text in _y_ticks(panel, place):
        yield _text(left - 4.0, bottom - place.height * float(place.y.place(at)) + FONT / 3, text, "end")
    if labelled and not panel.dates:
        yield _text(left + place.width / 2, bottom + 2 * FONT + 5.0, panel.x, "middle")
    middle = f"{left - LEFT + FONT:.1f},{top + place.height / 2:.1f}"
    label = escape(panel.y.replace("\n", " "))
    yield f'<text transform="translate({middle}) rotate(-90)" text-anchor="middle">{label}</text>' if label else ""
    yield _text(left, top - 4.0, panel.title, "start")
    for level in panel.levels:
        if level.words and level.axis == "x":
            # inside the panel, as its title stands above
            yield _text(left + place.width * float(place.x.place(level.value)) + 2.0, top + FONT, level.words, "start")


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>' if text else ""


def _legend(chart: Chart) -> tuple[str, float]:
    """What the colours stand for, each once, and the height that it takes."""
    marks: dict[str, str] = {}
    for panel in chart.panels:
        for zone in panel.zones:
            marks.setdefault(zone.label, f'<rect y="-7" width="14" height="7" fill="{zone.colour}"/>')
        for one in panel.series:
            dot = one.kind == "dots"
            line = 'd="M7-3h0" stroke-width="4" stroke-linecap="round"' if dot else 'd="M0-3h14" stroke-width="1.6"'
            line += ' stroke-dasharray="4 3"' if one.dashed and not dot else ""
            marks.setdefault(one.label, f'<path {line} stroke="{one.colour}"/>')
        for level in panel.levels:
            line = 'd="M0-3h14"' + (' stroke-dasharray="4 3"' if level.dashed else "")
            marks.setdefault(level.label, f'<path {line} stroke="{level.colour}"/>')
    marks.pop("", None)
    x, y, found = LEFT, LEGEND_ROW - 3.0, []
    for text, mark in marks.items():
        wide = 30.0 + LETTER * len(text)
        if x + wide > WIDTH and x > LEFT:
            x, y = LEFT, y + LEGEND_ROW
        found.append(f'<g transform="translate({x:.0f},{y:.0f})">{mark}<text x="18">{escape(text)}</text></g>')
        x += wide
    return "".join(found), y + 5.0 if marks else 0.0
