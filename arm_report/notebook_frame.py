"""A report inside a notebook."""

from __future__ import annotations

from html import escape

HEIGHT = 640
"""Pixels of the frame; a longer report scrolls in it."""


def inline(page: str) -> str:
    """A whole HTML page as a part of another one: in a frame, so that neither changes the style of the other.

    Its scripts run as those of a foreign page: they cannot reach the notebook.
    """
    style = f"width:100%;height:{HEIGHT}px;border:1px solid #d8dee6"
    return f'<iframe sandbox="allow-scripts" style="{style}" srcdoc="{escape(page)}"></iframe>'
