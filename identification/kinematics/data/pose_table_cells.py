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

ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180, "°": np.pi / 180}
LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}
"""Units that a column's name may state, "q1 [deg]": what its numbers are multiplied by."""
SEPARATORS = ";\t|"
"""Besides the comma; with them a number may have a decimal comma, as of a spreadsheet in Germany or France."""
_ANGLE = re.compile(r"(q[1-9]|r[xyz]|roll|pitch|yaw)[0-9]*")
_LENGTH = re.compile(r"(q[1-9]|[xyz]|target_[xyz])[0-9]*")
_STATED = re.compile(r"(\w+) ?(?:\[([^\]]*)\]|\(([^)]*)\))")


@dataclass(frozen=True)
class Cells:
    """The cells of a file; ``line`` of a row is its number + 2.

    names     of the columns, without the units
    factors   by which the numbers of a column become rad or m, of those whose name states another unit
    separator of the columns
    """

    path: Path
    names: list[str]
    cells: list[list[str]]
    factors: dict[str, float]
    separator: str

    def numbers(self, columns: list[str]) -> Array:
        """(rows, columns) in rad and m; NaN where a cell is empty."""
        texts = [self.texts(name) for name in columns]
        comma = self.separator != "," and any("," in text for column in texts for text in column)
        table = np.full((len(self.cells), len(columns)), np.nan)
        for k, name in enumerate(columns):
            for number, text in enumerate(texts[k]):
                if not text:
                    continue
                try:
                    table[number, k] = float(_with_point(text) if comma else text)
                except ValueError:
                    raise self.error(f"line {number + 2}: {name}: {text[:40]!r} is no number") from None
                if np.isinf(table[number, k]):
                    raise self.error(f"line {number + 2}: {name}: must be finite; leave out what is missing")
            table[:, k] *= self.factors.get(name, 1.0)
        return table

    def texts(self, name: str) -> list[str]:
        """The cells of one column."""
        column = self.names.index(name)
        return [row[column].strip() if column < len(row) else "" for row in self.cells]

    def error(self, what: str) -> InputError:
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
    columns = [_name_and_factor(path, cell.strip()) for cell in (rows[0] if rows else [])]
    names = [name for name, _ in columns]
    if repeated := [name for name in names if name and names.count(name) > 1]:
        raise InputError(path, f"line 1: column {repeated[0]!r} is there twice")
    for number, row in enumerate(rows[1:], 2):
        if any(cell.strip() for cell in row[len(names) :]):
            raise InputError(path, f"line {number}: has {len(row)} cells; line 1 has {len(names)} names")
    return Cells(path, names, rows[1:], {name: factor for name, factor in columns if factor != 1.0}, separator)


def _decoded(path: Path, content: bytes) -> str:
    """Text in UTF-8, in UTF-16 with a byte order mark, or in Windows-1252, as spreadsheets write it."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16")
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
    """A number with a decimal comma as Python reads it; ValueError: with a point as well, which may part thousands."""
    if "." in text:
        raise ValueError(text)
    return text.replace(",", ".")


def _name_and_factor(path: Path, cell: str) -> tuple[str, float]:
    """Name of a column, and what its numbers are multiplied by: of "x [mm]" or "x (mm)" x and 0.001."""
    stated = _STATED.fullmatch(cell)
    if stated is None:
        return cell, 1.0
    name, unit = stated[1], (stated[2] or stated[3] or "").strip()
    units = (ANGLES if _ANGLE.fullmatch(name) else {}) | (LENGTHS if _LENGTH.fullmatch(name) else {})
    if not units:
        return cell, 1.0
    if unit not in units:
        raise InputError(path, f"line 1: {cell[:40]!r}: {unit!r} is no unit of {name}; must be {', '.join(units)}")
    return name, units[unit]
