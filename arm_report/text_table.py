"""Tables in a terminal, or in a pipe: columns that line up, numbers that are never cut."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Collection, Sequence

NARROW = 80
"""Columns of a line where standard output is no terminal."""
_GAP = "  "
_LEAST = 6
"""Letters that a shortened column keeps."""


def line_width() -> int:
    """Columns of a line of standard output: the terminal's, at least ``NARROW``; of a pipe or a file ``NARROW``."""
    return max(NARROW, shutil.get_terminal_size((NARROW, 24)).columns) if sys.stdout.isatty() else NARROW


def text_table(
    rows: Sequence[Sequence[str]],
    head: Sequence[str],
    *,
    numbers: Collection[int] = (),
    shorten: Sequence[int] = (),
    width: int | None = None,
) -> list[str]:
    """Lines of a table, the head first.

    numbers  columns (from 0) that are set flush right and never cut
    shorten  columns of words that may be shortened ("Coulomb fri..."), the widest first, until a line fits; a table
             whose other columns are wider than a line is wider than it
    width    columns of a line; None: ``line_width()``
    """
    widths = [max(len(row[k]) for row in (head, *rows)) for k in range(len(head))]
    excess = sum(widths) + len(_GAP) * (len(head) - 1) - (line_width() if width is None else width)
    while excess > 0 and (wide := [k for k in shorten if widths[k] > max(_LEAST, len(head[k]))]):
        widest = max(wide, key=lambda k: widths[k])
        widths[widest] -= 1
        excess -= 1
    return [
        _GAP.join(
            cell.rjust(widths[k]) if k in numbers else _cut(cell, widths[k]).ljust(widths[k])
            for k, cell in enumerate(row)
        ).rstrip()
        for row in (head, *rows)
    ]


def _cut(cell: str, width: int) -> str:
    return cell if len(cell) <= width else f"{cell[: width - 3]}..."
