"""A figure as part of a page."""

from __future__ import annotations

import base64
import io
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100


def image(figure: Figure, alt: str) -> str:
    """The figure as an <img> with embedded data; ``alt`` describes it in words.

    On a narrow screen it can be scrolled.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'<div class=wide><img alt="{escape(alt)}" src="data:image/png;base64,{data}"></div>'
