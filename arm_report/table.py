"""A table of a page."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence


def table(
    rows: Iterable[Sequence[str]], head: Sequence[str], numbers: Collection[int] = (), weak: Collection[int] = ()
) -> str:
    """A table; cells are HTML. The last cell of a row that is shorter than ``head`` spans the columns that are left.

    numbers  columns (from 0) that hold numbers, set flush right
    weak     rows (from 0) in grey
    """
    body = "".join(
        f"<tr{' class=weak' if k in weak else ''}>{_line('td', row, len(head), numbers)}</tr>"
        for k, row in enumerate(rows)
    )
    return f"<div class=wide><table><tr>{_line('th', head, len(head), numbers)}</tr>{body}</table></div>"


def _line(tag: str, row: Sequence[str], columns: int, numbers: Collection[int]) -> str:
    cells = []
    for k, cell in enumerate(row):
        spans = columns - k if k == len(row) - 1 else 1
        kind = f" colspan={spans}" if spans > 1 else " class=n" if k in numbers else ""
        cells.append(f"<{tag}{kind}>{cell}</{tag}>")
    return "".join(cells)
