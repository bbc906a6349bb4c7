"""The cells of a table of poses: a CSV file by any spreadsheet, its separator, decimal mark and units."""

from __future__ import annotations

import codecs
import csv
import io
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm_io import InputError
from arm_io.files import open_regular
from arm_io.types import Array
from identification.kinematics.data.pose_table_names import SEPARATORS, header_of

ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180, "°": np.pi / 180}
LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}
"""Units that a column's name may state, "q1 [deg]": what its numbers are multiplied by."""
MISSING = ("", "-", "--", "n/a", "na", "#n/a", "#nv", "null")
"""Cells without a value, in lower case: as people and spreadsheets (English, German) write them."""
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(\.\d{3})+,\d+")
"""A number whose points can only part thousands: a comma follows them."""
_ANGLE = re.compile(r"(q[1-9]|r[xyz]|roll|pitch|yaw)[0-9]*")
_LENGTH = re.compile(r"(q[1-9]|[xyz]|target_[xyz])[0-9]*")
_STATED = re.compile(r"(\w+) ?(?:\[([^\]]*)\]|\(([^)]*)\))")


@dataclass(frozen=True)
class Cells:
    """The cells of a file.

    names     of the columns, without the units
    factors   by which the numbers of a column become rad or m, of those whose name states another unit
    separator of the columns
    first     line of the file, from 1, that row 0 stands in
    said      which columns were taken for what, where their names are not ours; ""
    """

    path: Path
    names: list[str]
    cells: list[list[str]]
    factors: dict[str, float]
    separator: str
    first: int = 2
    said: str = ""

    def line(self, row: int) -> int:
        """Line of a row of the table, from 1."""
        return row + self.first

    def numbers(self, columns: list[str]) -> Array:
        """(rows, columns) in rad and m; NaN where a cell is empty, or says that its value is missing (``MISSING``)."""
        texts = [self.texts(name) for name in columns]
        comma = self.separator != "," and any("," in text for column in texts for text in column)
        table = np.full((len(self.cells), len(columns)), np.nan)
        for k, name in enumerate(columns):
            for number, text in enumerate(texts[k]):
                if text.lower() in MISSING:
                    continue
                try:
                    table[number, k] = float(_with_point(text) if comma else text)
                except ValueError:
                    raise self.error(f"line {self.line(number)}: {name}: {text[:40]!r} is no number") from None
                if np.isinf(table[number, k]):
                    raise self.error(f"line {self.line(number)}: {name}: must be finite; leave out what is missing")
            table[:, k] *= self.factors.get(name, 1.0)
        return table

    def texts(self, name: str) -> list[str]:
        """The cells of one column."""
        column = self.names.index(name)
        return [row[column].strip() if column < len(row) else "" for row in self.cells]

    def error(self, what: str) -> InputError:
        """Unusable input, told with the file."""
        return InputError(self.path, what)


def read_cells(path: Path) -> Cells:
    """The table in a file.

    InputError: cannot be read, a column is there twice or in an unknown unit, or a row has more cells than names.
    """
    try:
        with os.fdopen(open_regular(path), "rb") as file:
            text = _decoded(path, file.read())
        separator = _separator(text)
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read as a CSV table: {getattr(error, 'strerror', None) or error}") from None
    header = None if _ours(rows[0] if rows else []) else header_of(text)
    if header is None:
        columns = [_name_and_factor(path, cell.strip()) for cell in (rows[0] if rows else [])]
        line, first, said = 0, 1, ""
    else:
        line, first, separator, said = header.line, header.first, header.separator, header.said
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator))
        columns = [
            (name, _factor(path, rows[line][k], name, header.units[k], line + 1)) for k, name in enumerate(header.names)
        ]
    names = [name for name, _ in columns]
    if repeated := [name for name in names if name and names.count(name) > 1]:
        alike = ", ".join(repr(rows[line][k].strip()) for k, name in enumerate(names) if name == repeated[0])
        raise InputError(path, f"line {line + 1}: column {repeated[0]!r} is there twice ({alike})")
    for number, row in enumerate(rows[first:], first + 1):
        if any(cell.strip() for cell in row[len(names) :]):
            raise InputError(path, f"line {number}: has {len(row)} cells; line {line + 1} has {len(names)} names")
    factors = {name: factor for name, factor in columns if factor != 1.0}
    return Cells(path, names, rows[first:], factors, separator, first + 1, said)


def _ours(cells: list[str]) -> bool:
    """Whether the names of columns are ours: q1 and x or x1, with or without a unit."""
    names = {match[1] if (match := _STATED.fullmatch(cell.strip())) else cell.strip() for cell in cells}
    return "q1" in names and any(re.fullmatch(r"x\d*", name) for name in names)


def _decoded(path: Path, content: bytes) -> str:
    """Text in UTF-8, in UTF-16 with a byte order mark, or in Windows-1252, as spreadsheets write it."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16")
    if content[1:200:2].count(0) > len(content[:200]) // 4:
        raise InputError(path, "seems to be in UTF-16 without a byte order mark; save it in UTF-8")
    if b"\0" in content:
        raise InputError(path, "is no text; save the table as CSV")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252")


def _separator(text: str) -> str:
    first = text.partition("\n")[0]
    return "," if "," in first else next((mark for mark in SEPARATORS if mark in first), ",")


def _with_point(text: str) -> str:
    """A number with a decimal comma as Python reads it; ValueError: with points whose meaning is not certain."""
    if _THOUSANDS.fullmatch(text):
        return text.replace(".", "").replace(",", ".")
    if "." in text:
        raise ValueError(text)
    return text.replace(",", ".")


def _name_and_factor(path: Path, cell: str) -> tuple[str, float]:
    """Name of a column, and what its numbers are multiplied by: of "x [mm]" or "x (mm)" x and 0.001."""
    stated = _STATED.fullmatch(cell)
    if stated is None:
        return cell, 1.0
    name, unit = stated[1], (stated[2] or stated[3] or "").strip()
    if not (_ANGLE.fullmatch(name) or _LENGTH.fullmatch(name)):
        return cell, 1.0
    return name, _factor(path, cell, name, unit, 1)


def _factor(path: Path, cell: str, name: str, unit: str, line: int) -> float:
    """What the numbers of a column are multiplied by; 1 without a stated unit. InputError: no unit of this column."""
    units = (ANGLES if _ANGLE.fullmatch(name) else {}) | (LENGTHS if _LENGTH.fullmatch(name) else {})
    if not unit or not units:
        return 1.0
    if unit not in units:
        raise InputError(path, f"line {line}: {cell[:40]!r}: {unit!r} is no unit of {name}; must be {', '.join(units)}")
    return units[unit]
