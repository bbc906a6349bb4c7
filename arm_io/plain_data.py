"""Plain data from outside (TOML, JSON) before anyone uses it: finite numbers, text, bounded nesting.

Every reader of a table comes through ``check_plain``. What a table means is checked after it, by the reader's own
model; there every comparison may then rely on numbers being ordered (a comparison with NaN is false, whatever the
limit).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from arm_io.errors import InputError

DEEPEST = 64
"""Tables and lists inside one another."""
LARGEST = 1e15
"""In SI units: no quantity of a rig or an arm is larger, and powers of it up to the twentieth are still numbers."""
INTEGER_BITS = 64
"""Of a signed integer (TOML 1.0), or of a register."""
_UNWRITABLE = re.compile("[\0\ud800-\udfff]")


def check_plain(where: str | Path, data: Any) -> None:
    """Raises InputError naming the first entry that is not plain.

    Not plain are a number that is not finite or larger than ``LARGEST``, an integer of more than 64 bits, text that is
    no UTF-8 or holds a NUL, and anything nested more than ``DEEPEST`` deep.

    data  tables (dict), lists, text, numbers, truth values, None and dates; ``where`` names their source
    """
    waiting: list[tuple[Any, _Place]] = [(data, None)]
    while waiting:
        value, place = waiting.pop()
        if isinstance(value, dict):
            children = [(entry, (place, key)) for key, entry in value.items()]
        elif isinstance(value, list):
            children = [(entry, (place, number)) for number, entry in enumerate(value, 1)]
        else:
            if wrong := _wrong(value):
                raise InputError(where, f"{_name(place)}: {wrong}" if place else wrong)
            continue
        if _depth(place) >= DEEPEST:
            raise InputError(where, f"{_name(place)[:80]}...: is nested more than {DEEPEST} deep")
        for key in value if isinstance(value, dict) else ():
            if wrong := _wrong(key):
                raise InputError(where, f"an entry's name {wrong}")
        waiting += reversed(children)


def point_of(text: str, option: str) -> tuple[float, float, float]:
    """Three coordinates X,Y,Z in m of a command line's option; InputError where they are not, or not finite."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(option, f"must be three numbers X,Y,Z in m (is {text!r})") from None
    check_plain(option, [x, y, z])
    return x, y, z


_Place = tuple["_Place", str | int] | None
"""Where an entry stands: its table's place, and its name in it, or its number from 1."""


def is_number(text: str) -> bool:
    """Whether Python reads a number in a text."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _wrong(value: object) -> str:
    """What is wrong with one entry, "" for nothing."""
    if isinstance(value, float) and not abs(value) <= LARGEST:
        return f"must be a finite number of at most {LARGEST:g} in magnitude (is {value:g})"
    if isinstance(value, int) and value.bit_length() > INTEGER_BITS:
        return f"must be an integer of at most {INTEGER_BITS} bits (has {value.bit_length()})"
    if isinstance(value, str) and _UNWRITABLE.search(value):
        return "must be UTF-8 text without NUL"
    return ""


def _depth(place: _Place) -> int:
    depth = 0
    while place is not None:
        place, depth = place[0], depth + 1
    return depth


def _name(place: _Place) -> str:
    """``joint[2].mass``; entries of lists are numbered from 1."""
    parts: list[str] = []
    while place is not None:
        place, key = place
        parts.append(f"[{key}]" if isinstance(key, int) else f".{key}")
    return "".join(reversed(parts)).removeprefix(".")
