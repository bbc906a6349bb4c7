"""What a notebook shows: a figure as an image, a whole report in a frame, a result as a table of pandas."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from typing import TYPE_CHECKING, Any

from arm_io import InputError
from arm_io.types import Array

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

DPI = 100
HEIGHT = 640
"""Pixels of the frame; a longer report scrolls in it."""


def drawing(width: float, height: float) -> Figure:
    """An empty figure, width and height in inches; the last one of a cell is shown, also without the inline backend."""
    from matplotlib.figure import Figure

    return _shown(Figure)(figsize=(width, height), layout="constrained")


@cache
def _shown(figure: type[Figure]) -> type[Figure]:
    class Drawing(figure):  # type: ignore[misc, valid-type]
        """A figure that a notebook asks for its image: matplotlib's own are shown only once pyplot is loaded."""

        def _repr_png_(self) -> bytes:
            buffer = io.BytesIO()
            self.savefig(buffer, format="png", dpi=DPI)
            return buffer.getvalue()

    return Drawing


def image(figure: Figure, alt: str) -> str:
    """The figure as an <img> with embedded data; ``alt`` describes it in words.

    On a narrow screen it can be scrolled.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'<div class=wide><img alt="{escape(alt)}" src="data:image/png;base64,{data}"></div>'


def inline(page: str) -> str:
    """A whole HTML page as a part of another one: in a frame, so that neither changes the style of the other.

    Its scripts run as those of a foreign page: they cannot reach the notebook.
    """
    style = f"width:100%;height:{HEIGHT}px;border:1px solid #d8dee6"
    return f'<iframe sandbox="allow-scripts" style="{style}" srcdoc="{escape(page)}"></iframe>'


def with_pandas() -> Any:
    """The package pandas. InputError where it is not installed."""
    try:
        import pandas
    except ImportError:
        raise InputError("to_pandas", "needs pandas: pip install 'armscope[notebook]'") from None
    return pandas


def frame_over_time(t: Array, columns: Mapping[str, Array], attributes: Mapping[str, Any]) -> pandas.DataFrame:
    """A table of columns (n,) indexed by t (n,), s. InputError where pandas is not installed."""
    package = with_pandas()
    frame: pandas.DataFrame = package.DataFrame(dict(columns), index=package.Index(t, name="t"))
    frame.attrs = dict(attributes)
    return frame


def frame_of(
    rows: Sequence[Mapping[str, Any]],
    columns: Sequence[str],
    index: str,
    attributes: Mapping[str, Any],
    *,
    whole: Sequence[str] = (),
    texts: Sequence[str] = (),
) -> pandas.DataFrame:
    """(rows, columns) a table indexed by the column ``index``; it has its columns without rows, too.

    A value that is not known (None) is NaN, in columns of ``whole`` numbers <NA>; ``texts``: columns of texts, in which
    it stays None. Other columns without any value are numbers. ``attributes`` become ``attrs`` of the table.
    InputError where pandas is not installed.
    """
    package = with_pandas()
    values = [[row.get(name) for name in (index, *columns)] for row in rows]
    frame: pandas.DataFrame = package.DataFrame.from_records(values)
    frame = frame.reindex(columns=range(1 + len(columns))).set_axis([index, *columns], axis="columns").set_index(index)
    for name in columns:
        known = [row[name] for row in rows if row.get(name) is not None]
        if name in whole:
            frame[name] = frame[name].astype("Int64")
        elif name not in texts and all(isinstance(one, int | float) and not isinstance(one, bool) for one in known):
            frame[name] = frame[name].astype("float64")
    frame.attrs = dict(attributes)
    return frame
