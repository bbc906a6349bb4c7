"""The text of a table above its first row: encoding, comments, and names, from which columns and joints follow.

Its size is limited before it is interpreted.
"""

from __future__ import annotations

import codecs
import csv
import difflib
import os
import re
from collections import Counter
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import TextIO

from arm_io import InputError, counted
from arm_io.files import open_regular, read_head
from arm_io.plain_data import is_number
from daq.recording.messages.row_format import JOINT_TOPICS
from daq.recording.tables.csv_time import is_instant

SAMPLE = 1 << 16
"""Bytes of a text by which it is judged."""
COMMENT = "#"
"""Begins the lines that a program writes above the names of the columns; numpy.savetxt the names, too."""
MOST_COMMENTS = 1000
MOST_PREAMBLE = 100
"""Lines above the first row that are no comments."""
_TEXT = frozenset(b"\t\n\r\f\x1a")
"""Control characters that texts have; the last ends those of DOS."""
_PACKED = {b"\x1f\x8b": "is packed by gzip", b"PK\x03\x04": "is an Excel workbook or a ZIP file"}
MOST_JOINTS = 64
MOST_NAMED = 8
"""Columns that a message names."""
LONGEST_HEADER = 1 << 16
"""Characters: 64 joints with all their columns take 3000."""
UNIT_WORD = re.compile(
    r"m?s|sec|[un]s|m?rad|deg|degrees|[Gg]rad|°|rev|[mc]?m|in|(rad|deg)/s|1/min|rpm|m?A|N[ *]?m|%|m?V|(°|deg)?C|K|-"
)
"""Units as programs write them below the names of their columns."""
JOINT_COLUMN = re.compile(rf"({'|'.join(JOINT_TOPICS)})([1-9][0-9]*)")
FROM_ZERO = re.compile(rf"({'|'.join(JOINT_TOPICS)})0[0-9]*")
"""Columns of joints that count from 0, or are numbered 01, 02, .."""
_KNOWN = "t, q1.., i1.., qref1.., ql1.., v1.., temp1.., x, y, z"
_NAMES = "the first line must name the columns: t (s), q1 (rad or m), i1 (A), .."


def encoding_of(path: str | Path) -> str:
    """The encoding of a text: UTF-8, UTF-16 with a byte order mark, else that of Western Windows, whose names it keeps.

    InputError for a file that is no text.
    """
    head = read_head(path, SAMPLE)
    for start, what in _PACKED.items():
        if head.startswith(start):
            raise InputError(path, f"{what}; unpack it, or save the table as CSV")
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if head[1::2].count(0) > len(head) // 4:
        raise InputError(path, "seems to be in UTF-16 without a byte order mark; save it in UTF-8")
    if any(byte < 32 and byte not in _TEXT for byte in set(head)):
        raise InputError(path, "is no text; expected a table as CSV, or another format by the ending of its name")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def open_text(path: str | Path) -> TextIO:
    """The text of a file, line ends as they are; the caller closes it. InputError for a file that is no text."""
    encoding = encoding_of(path)
    return os.fdopen(open_regular(path), encoding=encoding, newline="")


def last_line(path: str | Path) -> str:
    """The last line of a text that is not blank."""
    encoding = encoding_of(path)
    with os.fdopen(open_regular(path), "rb") as file:
        start = file.read(2)
        file.seek(max(file.seek(0, os.SEEK_END) - SAMPLE, 0) // 2 * 2)
        if encoding == "utf-16":
            encoding = "utf-16-le" if start == codecs.BOM_UTF16_LE else "utf-16-be"
        text = file.read().decode(encoding, errors="replace")
    return next((line for line in reversed(text.split("\n")) if line.strip()), "")


def names_of(lines: Sequence[str], separator: str) -> tuple[list[str], int]:
    """The names of the columns in the first lines of a text, and the number of lines before the first row.

    They stand in the line above the first row of numbers, in as many cells as that row has; the lines above are a
    program's preamble. Two such lines without numbers are one header: the first one names a group of columns above its
    first column, the second one has their own names, or their units, which go into brackets.
    If no line is followed by such a row, the names are in the first line that is not a comment; if that one holds
    numbers, in the last comment.
    """
    comments = 0
    while comments < len(lines) and lines[comments].lstrip("\ufeff ").startswith(COMMENT):
        comments += 1
    if comments and (comments == len(lines) or is_number(_first_cell(lines[comments]))):
        return cells_of(lines[comments - 1].lstrip("\ufeff ").removeprefix(COMMENT).lstrip(), separator), comments
    body = [number for number in range(comments, len(lines)) if lines[number].strip()][: MOST_PREAMBLE + 1]
    cells = [cells_of(lines[number], separator) for number in body]
    first = next((place for place, row in enumerate(cells) if _is_row(row, separator)), 0)
    header = [
        place for place in range(max(first - 2, 0), first) if _may_name(cells[place], len(cells[first]), separator)
    ]
    if not header or header[-1] != first - 1:
        return cells_of(lines[comments], separator) if comments < len(lines) else [], comments + 1
    names = _joined(*(cells[place] for place in header)) if len(header) == 2 else cells[header[0]]
    return names, body[header[-1]] + 1


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without quotes and blanks around them."""
    try:
        cells = next(csv.reader([line.strip("\ufeff\r\n")], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # a text in quotes that does not end in this line
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def _is_row(cells: Sequence[str], separator: str) -> bool:
    """Whether cells are a row: three numbers or times at least, and half of all."""
    there = sum(_is_value(cell, separator) for cell in cells)
    return there >= max(3, len(cells) / 2)


def _may_name(cells: Sequence[str], columns: int, separator: str) -> bool:
    """Whether cells may be the names of so many columns."""
    return len(cells) == columns and any(cells) and not any(_is_value(cell, separator) for cell in cells)


def _is_value(cell: str, separator: str) -> bool:
    number = cell if separator == "," else cell.replace(",", ".")
    return is_number(number) or is_instant(cell)


def _joined(groups: Sequence[str], names: Sequence[str]) -> list[str]:
    """The names of columns in two lines: groups of columns, each above its first one, and names or units below."""
    joined, group = [], ""
    for above, below in zip(groups, names):
        group = above or group
        unit = below.strip("[]()")
        joined.append(f"{group} [{unit}]" if UNIT_WORD.fullmatch(unit) else f"{group} {below}".strip())
    return joined


def read_header(path: str | Path, file: TextIO, separator: str) -> tuple[list[str], int]:
    """The names of the columns of an open table, and how many lines stand before its first row.

    InputError where the names are too long, or separated otherwise than by ``separator``.
    """
    lines = [file.readline(LONGEST_HEADER + 1)]
    if not lines[0].strip("\ufeff \r\n") and not file.readline(1):
        raise InputError(path, f"is empty; {_NAMES}")
    while lines[-1].lstrip().startswith(COMMENT) and len(lines) <= MOST_COMMENTS:
        lines.append(file.readline(LONGEST_HEADER + 1))
    if len(lines[-1]) > LONGEST_HEADER:
        raise InputError(path, f"line 1: is longer than {LONGEST_HEADER} characters; it must name the columns")
    lines += islice(iter(lambda: file.readline(LONGEST_HEADER + 1), ""), MOST_PREAMBLE)
    names, before = names_of(lines, separator)
    if separator == "," and len(names) == 1 and (found := re.search(r"[;\t|]", names[0])):
        there = [f"{name.strip()!r}" for name in names[0].split(found[0])]
        raise InputError(
            path,
            f"columns are separated by {found[0]!r}, and their names do not say which are time, position and current; "
            "use --map MAPPING.toml (docs/recordings.md), or commas, decimal points and the names t, q1, i1, ..; there "
            f"are {first_names(there)}",
        )
    if len(names) > 1 and not names[-1]:
        names.pop()
    if len(names) > 1 and all(map(is_number, names)):
        raise InputError(path, f"line 1: has numbers; {_NAMES}")
    return names, before


def first_names(names: Sequence[str]) -> str:
    """The names of columns for a message: the first ``MOST_NAMED`` of them."""
    return ", ".join(names[:MOST_NAMED]) + (f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")


def _first_cell(line: str) -> str:
    """The first cell of a row, with any separator."""
    return re.split(r"[,;\t| ]", line.lstrip(), maxsplit=1)[0].strip("\"'")


def joints_of(path: str | Path, names: Sequence[str], joints: int | None, keep_extra: bool, where: str) -> int:
    """The number of joints, if the columns are as they should be; InputError otherwise.

    joints  that the rig or the model has; None: as many as there are columns q1, q2, ...
    where   of the names in messages
    """
    for name, times in Counter(names).items():
        if times > 1:
            raise InputError(path, f"{where}column {name!r} is there twice")
    by_joint = [match for name in names if (match := JOINT_COLUMN.fullmatch(name))]
    for match in by_joint:
        if len(match[2]) > len(str(MOST_JOINTS)) or int(match[2]) > MOST_JOINTS:
            raise InputError(
                path, f"{where}column {match[0][:40]}: joints are numbered from 1 to at most {MOST_JOINTS}"
            )
    if foreign := next((name for name in names if FROM_ZERO.fullmatch(name)), None):
        raise InputError(
            path,
            f"{where}column {foreign[:40]}: joints count from 1 (q1, i1, ..); --guess takes such columns in the order "
            "of their numbers, --map says which is which",
        )
    of_angles = [int(match[2]) for match in by_joint if match[1] == "q"]
    count = joints or max(of_angles or [int(match[2]) for match in by_joint], default=1)
    needed = ["t", *(f"{signal}{joint}" for joint in range(1, count + 1) for signal in "qi")]
    known = {*needed, *"xyz", *(f"{signal}{joint}" for signal in JOINT_TOPICS for joint in range(1, count + 1))}
    unknown = [name for name in names if name not in known]
    _check_missing(path, names, needed, unknown, joints, where)
    for match in by_joint:
        if match[0] in unknown:
            owner = "the arm" if joints else "the table (columns q1, q2, ...)"
            raise InputError(path, f"{where}column {match[0]}, but {owner} has {counted(count, 'joint')}")
    if unknown and not keep_extra:
        raise InputError(
            path, f"{where}column {unknown[0]!r} is unknown; known are {_KNOWN}; --keep-extra keeps others"
        )
    if 0 < sum(axis in names for axis in "xyz") < 3:
        raise InputError(path, f"{where}the tracker's columns x, y, z must be all there, or none")
    return count


def _check_missing(
    path: str | Path,
    names: Sequence[str],
    needed: Sequence[str],
    unknown: Sequence[str],
    joints: int | None,
    where: str,
) -> None:
    missing = [name for name in needed if name not in set(names)]
    if not missing:
        return
    if missing[0] == "t" and any({"q1", *point} <= set(names) for point in ("xyz", ("x1", "y1", "z1"))):
        raise InputError(
            path,
            f"{where}column t is missing: a table of poses (q1, q2, .. and x, y, z or x1, y1, z1, x2, .., one row per "
            "pose) needs no import; give it to 'armscope calibrate'",
        )
    close = difflib.get_close_matches(missing[0], unknown[:1000], 1, 0.5)
    hint = f"; is it {close[0]!r}?" if close else ""
    more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
    arm = f"; the arm has {counted(joints, 'joint')}" if joints else ""
    listed = f"{', '.join(unknown[:8])}{', ..' * (len(unknown) > 8)}"
    other = f"; --map says which of {listed} are t, q1, i1, .. (docs/recordings.md)" if unknown else ""
    right = hint or other + arm or "; every row needs t (s), every joint q (rad or m) and i (A)"
    raise InputError(path, f"{where}column {missing[0]} is missing{more}{right}")
