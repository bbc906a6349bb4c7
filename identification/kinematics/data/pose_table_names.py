"""Which columns of a table of poses mean what, where another program, or a person, has named them."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

SEPARATORS = ";\t|"
"""Besides the comma; with them a number may have a decimal comma, as of a spreadsheet in Germany or France."""
SEARCHED = 60
"""Lines at the beginning of a file among which the names of the columns are looked for: a protocol has a head."""
SPELLED = {
    "grad": "deg", "degree": "deg", "degrees": "deg", "degré": "deg", "degrés": "deg", "degre": "deg", "degres": "deg",
    "grados": "deg", "gradi": "deg", "radian": "rad", "radians": "rad", "metre": "m", "meter": "m", "millimeter": "mm",
}  # fmt: skip
"""Other words for the units of a table."""
_ACTUAL = r"([ _.]*(position|pos|angle|winkel|ist|istwert|actual|measured|gemessen|mesurée?))?"
_JOINT = re.compile(
    r"(q|j|a|joint|axis|achse|gelenk|axe|articulation|eje|articulación|asse|giunto|theta|θ)[ _.]*(?P<number>\d{1,2})"
    + _ACTUAL,
    re.IGNORECASE,
)
_SEEN = r"smr|refl|reflector|reflektor|réflecteur|reflecteur|target|ziel|cible|prisma|prism"
_POINT = re.compile(
    rf"(({_SEEN}|r|p)[ _.]*(?P<before>[1-9]\d?)[ _.]*)?(?P<axis>[xyz])([ _.]*(?P<after>[1-9]\d?))?" + _ACTUAL,
    re.IGNORECASE,
)
_REFLECTOR = re.compile(rf"({_SEEN})([ _.]*(name|nr\.?|no\.?|id))?", re.IGNORECASE)
_STATED = re.compile(r"(?P<name>.+?)[ _]*(\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\))")


@dataclass(frozen=True)
class Header:
    """Where the names of a table are, and what they mean.

    separator  of the columns
    line       of the names, from 0; first: of the first row of numbers
    names      of the columns, ours where they are known; units of these, "" where none is stated
    said       a sentence that says which columns were taken for what
    """

    separator: str
    line: int
    first: int
    names: list[str]
    units: list[str]
    said: str


def meaning(cell: str) -> tuple[str, str]:
    """Our name of a column (q1, x, x1, reflector; its own where nothing is known of it) and the unit that it states."""
    text = cell.strip()
    stated = _STATED.fullmatch(text)
    name = stated["name"].strip() if stated else text
    unit = (stated["square"] or stated["round"] or "").strip() if stated else ""
    if match := _JOINT.fullmatch(name):
        return f"q{int(match['number'])}", unit
    match = _POINT.fullmatch(name)
    if match and not (match["before"] and match["after"]):
        return f"{match['axis'].lower()}{match['before'] or match['after'] or ''}", unit
    if _REFLECTOR.fullmatch(name):
        return "reflector", unit
    return text, ""


def header_of(text: str) -> Header | None:
    """The first line that names joints and points in any of the known ways; None where no line does."""
    for separator in (*SEPARATORS, ","):
        rows = list(islice(csv.reader(io.StringIO(text, newline=""), delimiter=separator), SEARCHED))
        for line, row in enumerate(rows):
            found = [meaning(cell) for cell in row]
            names = [name for name, _ in found]
            points = [
                name[1:] for name in names if name.startswith("x") and {f"y{name[1:]}", f"z{name[1:]}"} <= {*names}
            ]
            if points and ({"q1", "q2"} <= {*names} or {"q0", "q1"} <= {*names}):
                return _header(separator, line, row, found, rows[line + 1] if line + 1 < len(rows) else [])
    return None


def _header(
    separator: str, line: int, row: Sequence[str], found: Sequence[tuple[str, str]], below: Sequence[str]
) -> Header:
    names = [name for name, _ in found]
    if "q0" in names:
        names = [f"q{int(name[1:]) + 1}" if re.fullmatch(r"q\d+", name) else name for name in names]
    units = [_spelled(unit) for _, unit in found]
    ours = [k for k, name in enumerate(names) if re.fullmatch(r"q\d+|[xyz]\d*", name)]
    shown = [k for k, name in enumerate(names) if k in ours or name == "reflector"]
    beneath = [_spelled(below[k].strip(" []()")) if k < len(below) else "" for k in ours]
    under = all(unit in _UNITS for unit in beneath)
    if under:
        for k, unit in zip(ours, beneath):
            units[k] = units[k] or unit
    said = ", ".join(
        f"{names[k]} = {row[k].strip()!r}" + (f" ({units[k]})" if under and units[k] else "") for k in shown
    )
    return Header(separator, line, line + 1 + under, names, units, f"line {line + 1} names the columns: {said}")


_UNITS = {"rad", "mrad", "deg", "°", "m", "mm", "cm"}


def _spelled(unit: str) -> str:
    return SPELLED.get(unit.lower(), unit)
