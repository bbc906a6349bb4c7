"""Tables as CSV, read block by block: the columns of docs/recordings.md, every number to the last bit."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from arm_io import InputError
from arm_io.progress import report
from arm_io.types import Array
from daq.recording.tables.columns import Chunk, Table, read_blocks
from daq.recording.tables.csv_header import MOST_PREAMBLE, last_line, open_text, read_header
from daq.recording.tables.csv_time import TimeUnit, in_ns, is_instant
from daq.recording.tables.mapping import Mapping

BLOCK_CHARACTERS = 1 << 20
"""Of the text that is read at once."""

_TIMES = "; of times, 2026-03-01 10:00:00.125, 01.03.2026 10:00:00,125 and 10:00:00.125 are read"


def read_csv(
    path: str | Path, *, joints: int | None = None, keep_extra: bool = False, unit: TimeUnit | None = None
) -> Table:
    """Reads a table whole; arguments and errors as ``read_csv_blocks`` has them."""
    blocks = list(read_csv_blocks(path, joints=joints, keep_extra=keep_extra, unit=unit))
    first = blocks[0]
    return replace(
        first,
        t=np.concatenate([block.t for block in blocks]),
        signals={name: np.concatenate([block.signals[name] for block in blocks]) for name in first.signals},
        xyz=None if first.xyz is None else np.concatenate([block.xyz for block in blocks if block.xyz is not None]),
        extra={name: np.concatenate([block.extra[name] for block in blocks]) for name in first.extra},
    )


def read_csv_blocks(
    path: str | Path, *, joints: int | None, keep_extra: bool, unit: TimeUnit | None
) -> Iterator[Table]:
    """Reads a table in our columns, some lines at a time; arguments and errors as ``read_blocks`` has them."""
    return read_blocks(CsvSource(path), joints=joints, keep_extra=keep_extra, unit=unit)


class CsvSource:
    """A CSV as a source of columns (``daq.recording.tables.columns.Source``).

    separator, decimal  as ``Mapping`` has them
    A first column without a name, as pandas writes the numbers of its rows, is left out; where it has instants and no
    other column is the time, it is t.
    InputError where it cannot be read, or its first line is too long or separated otherwise.
    """

    word = "line"
    mapping: Mapping | None = None
    rows: int | None = None

    def __init__(self, path: str | Path, separator: str = ",", decimal: str = ".") -> None:
        self.path, self._separator, self._decimal = Path(path), separator, decimal
        try:
            with self._open() as file:
                self._all, self._before = read_header(path, file, separator)
            self.where = f"line {max(self._before, 1)}: "
            self._header = "the first line" if self._before == 1 else f"line {self._before}"
            with self._open() as file:
                first = self._first_row(file)
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise _unreadable(path, error) from None
        self._instants = {name for name, cell in zip(self._all, first) if is_instant(cell)}
        if len(self._all) > 1 and not self._all[0] and "" in self._instants and "t" not in self._all:
            self._all[0] = "t"
            self._instants.add("t")
        self._unnamed = len(self._all) > 1 and not self._all[0]
        self.names: list[str] = self._all[1:] if self._unnamed else self._all

    def chunks(self, needed: Sequence[str], time: str) -> Iterator[Chunk]:
        """All lines in their order; instants as ns since 1970."""
        places = {name: self._all.index(name) for name in needed}
        before = None
        try:
            with self._open() as file:
                for _ in range(self._before):
                    file.readline()
                for lines, cells, plain in self._blocks(file):
                    if time in self._instants:
                        cells[places[time]] = in_ns(self.path, time, lines, cells[places[time]], before)
                        before = int(cells[places[time]][-1])
                    columns = {
                        name: _numbers(self.path, name, lines, cells[place], plain=plain)
                        for name, place in places.items()
                    }
                    yield Chunk(lines, columns, cells[places[time]])
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise _unreadable(self.path, error) from None

    def last_time(self, time: str) -> str:
        """The text in the column of times of the last line; "" where it is unknown."""
        cells = last_line(self.path).split(self._separator)
        column = self._all.index(time)
        if column >= len(cells):
            return ""
        cell = cells[column].strip().replace(self._decimal, ".")
        return in_ns(self.path, time, [0], [cell])[0] if is_instant(cell) else cell

    def unit_of(self, time: str) -> TimeUnit | None:
        """Ns, where the column has instants."""
        return TimeUnit.NS if time in self._instants else None

    def notes(self) -> list[str]:
        """What was left out."""
        return ["the first column has no name, as numbers of rows have none: left out"] if self._unnamed else []

    def _open(self) -> TextIO:
        return open_text(self.path)

    def _first_row(self, file: TextIO) -> list[str]:
        """Cells of the first row, empty where there is none."""
        for _ in range(self._before):
            file.readline()
        line = next(filter(str.strip, islice(iter(lambda: file.readline(BLOCK_CHARACTERS), ""), MOST_PREAMBLE)), "")
        return [cell.strip() for cell in next(csv.reader([line], delimiter=self._separator), [])]

    def _blocks(self, file: TextIO) -> Iterator[tuple[list[int], list[tuple[str, ...]], bool]]:
        """The number of each line with cells, the cells by column, and whether all of them read as they look."""
        line, width, size = self._before, len(self._all), os.fstat(file.fileno()).st_size
        while text := file.readlines(BLOCK_CHARACTERS):
            reader = csv.reader(text, delimiter=self._separator, skipinitialspace=self._separator == " ")
            rows = [(line + reader.line_num, row) for row in reader if row]
            for number, row in rows:
                if len(row) == width + 1 and not row[-1].strip():  # the line ends with a separator
                    row.pop()
                if len(row) != width:
                    raise InputError(
                        self.path, f"line {number}: has {len(row)} cells, {self._header} names {width} columns"
                    )
            if rows:
                plain = not any("_" in one for one in text)
                cells = list(zip(*(row for _, row in rows)))
                if self._decimal != ".":
                    cells = [tuple(cell.replace(self._decimal, ".") for cell in column) for column in cells]
                yield [number for number, _ in rows], cells, plain
            line += len(text)
            report("reading", file.buffer.tell(), size)


def _unreadable(path: str | Path, error: Exception) -> InputError:
    return InputError(path, f"cannot be read as a CSV text in UTF-8: {error}")


def _numbers(path: str | Path, name: str, lines: Sequence[int], cells: Sequence[str], *, plain: bool) -> Array:
    try:
        values = np.array(list(map(float, cells)))
    except ValueError:
        try:
            values = np.array([float(cell or "nan") for cell in cells])
        except ValueError:
            plain = False
    if plain and not np.isinf(values).any():
        return values
    return np.array([_number(path, name, line, cell.strip()) for line, cell in zip(lines, cells)])


def _number(path: str | Path, name: str, line: int, cell: str) -> float:
    """One cell as a number; slow, used to find the wrong one."""
    try:
        value = float(cell.replace("_", "?") or "nan")
    except ValueError:
        hint = _TIMES if ":" in cell else "" if cell.count(".") < 2 else "; thousands must not be separated"
        raise InputError(
            path, f"line {line}, column {name}: {cell!r} is no number; a missing sample is an empty cell{hint}"
        ) from None
    if np.isinf(value):
        raise InputError(path, f"line {line}, column {name}: {cell!r} is not finite; a missing sample is an empty cell")
    return value
