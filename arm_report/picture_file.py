"""The picture that a command writes: where it may go, and writing it. A figure drawn twice is the same file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from arm_io import InputError, check_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = (".png", ".svg", ".pdf")
DATE_OF = {"svg": "Date", "pdf": "CreationDate"}
"""What the metadata of a kind call the time of writing."""


def check_picture(path: Path) -> None:
    """InputError where a picture cannot be written there."""
    if path.suffix.lower() not in PICTURES:
        raise InputError(path, "the name of a picture must end in .png, .svg or .pdf")
    check_file(path)


def save_picture(figure: Figure, path: Path, dpi: float = 110) -> None:
    """Writes a picture; InputError where it cannot be written."""
    import matplotlib

    # by its format: matplotlib takes "..png" for a name without an ending, and adds one
    kind = path.suffix[1:].lower()
    dates = {DATE_OF[kind]: None} if kind in DATE_OF else None
    try:
        # names in an SVG file are random without a salt
        with matplotlib.rc_context({"svg.hashsalt": "armscope"}):
            figure.savefig(path, dpi=dpi, format=kind, metadata=dates)
    except OSError as error:
        raise InputError(path, f"cannot be written: {error.strerror}") from None
