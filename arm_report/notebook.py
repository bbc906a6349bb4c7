"""What a notebook shows: a figure as an image, a whole report in a frame."""

from __future__ import annotations

import base64
import io
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100
HEIGHT = 640
"""Pixels of the frame; a longer report scrolls in it."""


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
