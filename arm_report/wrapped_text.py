"""Long lines in a terminal: broken between words, where a number keeps its unit."""

from __future__ import annotations

import re
import sys

from arm_report.terminal_table import line_width

_NUMBER = re.compile(r"[(\[]?[-+]?\.?\d\S*")
_ONE_UNIT = r"(?:[kmuµ]?(?:g|m|N|A|V|s|rad|Hz|degC|K)\d?|1|%|rpm|rows|counts)"
_UNIT = re.compile(rf"\(?{_ONE_UNIT}(?:/\(?{_ONE_UNIT})*\)?[,.;:)]*")
_JOINTS = frozenset(("+-", "->", "="))
"""What stands between two numbers that belong together."""


def wrapped(text: str, width: int | None = None) -> str:
    """The text with its long lines broken between words, continued two columns further in; others stay as they are.

    A number, its deviation and its unit ("2.5 +- 0.1 N m") stay on one line; a word that is longer than a line, such as
    a path, stays whole. width: columns of a line; None: of the terminal, and without a terminal no line is broken.
    """
    if width is None:
        if not sys.stdout.isatty():
            return text
        width = line_width()
    return "\n".join(part for line in text.split("\n") for part in _broken(line, width))


def _broken(line: str, width: int) -> list[str]:
    if len(line) <= width:
        return [line]
    margin = line[: len(line) - len(line.lstrip())]
    parts: list[str] = []
    current, gap = margin, ""
    for space, words in _together(line[len(margin) :]):
        if current.strip() and len(current) + len(space) + len(words) > width:
            parts.append(current)
            current, gap = f"{margin}  {words}", ""
        else:
            current += (space if current.strip() else gap) + words
    return [*parts, current]


def _together(line: str) -> list[tuple[str, str]]:
    """Words, each with the space before it; what must not be broken is one word."""
    found: list[tuple[str, str]] = []
    last = ""
    for space, word in re.findall(r"(\s*)(\S+)", line):
        if found and len(space) == 1 and _belong(last, word):
            found[-1] = (found[-1][0], f"{found[-1][1]}{space}{word}")
        else:
            found.append((space, word))
        last = word
    return found


def _belong(one: str, other: str) -> bool:
    """Whether two words stay together: number and unit, parts of a unit, number and deviation."""
    if one in _JOINTS or other in _JOINTS:
        return True
    if _UNIT.fullmatch(other):
        return bool(_NUMBER.fullmatch(one) or _UNIT.fullmatch(one))
    return False
