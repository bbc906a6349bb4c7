"""What ``armscope`` alone and ``armscope --help`` print: options, commands and exit statuses, without a parser.

Python's own start takes 0.01 s of CPU, importing Typer 0.1 s, which a list of commands does not need.
"""

from __future__ import annotations

import os
import textwrap
from collections.abc import Mapping, Sequence

from armscope import __version__
from armscope.usage import COMMANDS

OPTIONS = {
    "-V, --version": "print the version",
    "--no-color": "no colours, like the environment variable NO_COLOR",
    "-h, --help": "show the options and commands",
}
PURPOSE = "Measures a robot arm, and finds what its model gets wrong."
MORE = (
    "Details and examples: armscope COMMAND --help. Exit status: 0 done, 2 invalid input, 3 a device failed, "
    "4 done but samples were lost, 5 changed (compare --fail-above, trend --fail-within)."
)
NARROWEST, WIDEST = 45, 80
"""Columns of the text."""


def answer(arguments: Sequence[str]) -> str | None:
    """What the arguments ask for, if that is the overview or the version; None for all that a parser must read."""
    if len(arguments) > 1:
        return None
    first = arguments[0] if arguments else "help"
    if first in ("help", "-h", "--help"):
        return overview()
    return f"armscope {__version__}" if first in ("-V", "--version") else None


def overview(columns: int | None = None) -> str:
    """Options, commands with one line each, exit statuses; columns: of the terminal, if not given."""
    width = max(NARROWEST, min(WIDEST, columns or _columns())) - 2
    parts = [
        "Usage: armscope [OPTIONS] COMMAND [ARGS]...",
        _indented(PURPOSE, width),
        "Options:\n" + _pairs(OPTIONS, width),
        "Commands:\n" + _pairs(COMMANDS, width),
        _indented(MORE, width),
    ]
    return "\n\n".join(parts)


def _indented(text: str, width: int) -> str:
    return textwrap.fill(text, width, initial_indent="  ", subsequent_indent="  ")


def _pairs(pairs: Mapping[str, str], width: int) -> str:
    """Two columns; names longer than others do not occur."""
    first = max(map(len, pairs)) + 4
    return "\n".join(
        textwrap.fill(text, width, initial_indent=f"  {name}".ljust(first), subsequent_indent=" " * first)
        for name, text in pairs.items()
    )


def _columns() -> int:
    """Of the terminal, COLUMNS before it, 80 without either. shutil's function would import five compressors."""
    try:
        return int(os.environ.get("COLUMNS", "")) or os.get_terminal_size(1).columns
    except (ValueError, OSError):
        return WIDEST
