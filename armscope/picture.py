"""The picture that a command writes: where it may go, and writing it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from arm_io import InputError, check_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = (".png", ".svg", ".pdf")


def check_picture(path: Path) -> None:
    """InputError where a picture cannot be written there."""
    if path.suffix.lower() not in PICTURES:
        raise InputError(path, "the name of a picture must end in .png, .svg or .pdf")
    check_file(path)


def save_picture(figure: Figure, path: Path) -> None:
    """Writes a picture; InputError where it cannot be written."""
    try:
        # by its format: matplotlib takes "..png" for a name without an ending, and adds one
        figure.savefig(path, dpi=110, format=path.suffix[1:].lower())
    except OSError as error:
        raise InputError(path, f"cannot be written: {error.strerror}") from None
