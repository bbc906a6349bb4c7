"""A table as text: how its bytes are read, and where its names stand behind the comments of a program."""

from __future__ import annotations

import codecs
import os
from pathlib import Path
from typing import TextIO

from arm_io import InputError
from arm_io.files import open_regular, read_head

SAMPLE = 1 << 16
"""Bytes of a text by which it is judged."""
COMMENT = "#"
"""Begins the lines that a program writes above the names of the columns; numpy.savetxt the names, too."""
MOST_COMMENTS = 1000
_TEXT = frozenset(b"\t\n\r\f\x1a")
"""Control characters that texts have; the last ends those of DOS."""
_PACKED = {b"\x1f\x8b": "is packed by gzip", b"PK\x03\x04": "is an Excel workbook or a ZIP file"}


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


def names_line(lines: list[str]) -> tuple[str, int]:
    """The line that names the columns, and how many lines stand before the first row.

    That is the first line that is no comment; where that has numbers, the last comment.
    """
    comments = 0
    while comments < len(lines) and lines[comments].lstrip("\ufeff ").startswith(COMMENT):
        comments += 1
    if comments and (comments == len(lines) or _has_numbers(lines[comments])):
        return lines[comments - 1].lstrip("\ufeff ").removeprefix(COMMENT).lstrip(), comments
    return lines[comments] if comments < len(lines) else "", comments + 1


def _has_numbers(line: str) -> bool:
    """Whether a line begins as a row does."""
    first = line.lstrip("\" '").replace(";", ",").replace("\t", ",").replace(" ", ",").split(",")[0].strip("\"'")
    try:
        float(first)
    except ValueError:
        return False
    return True
