"""Tables in a terminal, or in a pipe: columns that line up, numbers that are never cut."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Collection, Sequence

NARROW = 80
"""Columns of a line where standard output is no terminal."""
_GAP = "  "
_LEAST, _LEAST_OF_A_LINE = 6, 16
"""Letters that a shortened column keeps; more where a line may be too long in any case."""
_OF_A_NUMBER = frozenset("0123456789.")


def line_width() -> int:
    """Columns of a line of standard output: of a terminal its own, of a pipe or a file ``NARROW``."""
    return max(20, shutil.get_terminal_size((NARROW, 24)).columns) if sys.stdout.isatty() else NARROW


def text_table(
    rows: Sequence[Sequence[str]],
    head: Sequence[str],
    *,
    numbers: Collection[int] = (),
    shorten: Sequence[int] = (),
    keep: Collection[int] | None = (0,),
    width: int | None = None,
) -> list[str]:
    """Lines of a table, the head first. A table that is too wide continues below itself, by whole columns.

    numbers  columns (from 0) that are set flush right and never cut
    shorten  columns of words that may be shortened ("Coulomb fri..."), the widest first, until a line fits
    keep     columns that stand in every part of a table that continues: names of rows, units; None: the table never
             continues, a line that is too long stays so, such as one with a path at its end
    width    columns of a line; None: of the terminal. Only where ``keep`` and one more column are wider, a line is.
             In a pipe, where words are searched and nothing is drawn, a table is whole
    """
    if width is None:
        width = line_width() if sys.stdout.isatty() else sys.maxsize
    least = _LEAST if keep is not None else _LEAST_OF_A_LINE
    widths = [max(len(row[k]) for row in (head, *rows)) for k in range(len(head))]
    excess = _total(widths, range(len(head))) - width
    while excess > 0 and (wide := [k for k in shorten if widths[k] > max(least, len(head[k]))]):
        widest = max(wide, key=lambda k: widths[k])
        widths[widest] -= 1
        excess -= 1
    lines: list[str] = []
    for part in _parts(widths, keep, width):
        lines += [""] * bool(lines)
        lines += [
            _GAP.join(
                row[k].rjust(widths[k]) if k in numbers else cut(row[k], widths[k]).ljust(widths[k]) for k in part
            ).rstrip()
            for row in (head, *rows)
        ]
    return lines


def cut(cell: str, width: int) -> str:
    """A cell of at most ``width`` letters, with "..." for what is left out; a number in it is whole or left out."""
    if len(cell) <= width:
        return cell
    kept = cell[: width - 3]
    if kept and {kept[-1], cell[len(kept)]} <= _OF_A_NUMBER:
        kept = kept.rstrip("0123456789.")
    return f"{kept}..."


def _total(widths: Sequence[int], columns: Collection[int]) -> int:
    return sum(widths[k] for k in columns) + len(_GAP) * (len(columns) - 1)


def _parts(widths: Sequence[int], keep: Collection[int] | None, width: int) -> list[list[int]]:
    """Columns of each part of a table: those of ``keep``, and as many others as fit."""
    if keep is None or _total(widths, range(len(widths))) <= width:
        return [list(range(len(widths)))]
    parts: list[list[int]] = []
    for column in (k for k in range(len(widths)) if k not in keep):
        if parts and _total(widths, [*parts[-1], column]) <= width:
            parts[-1].append(column)
        else:
            parts.append([*keep, column])
    return [sorted(part) for part in parts]
