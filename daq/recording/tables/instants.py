"""Instants as texts, such as 2026-03-01 10:00:00.125+01:00 (ISO 8601): in ns since 1970, exactly."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from arm_io import InputError

_INSTANT = re.compile(
    r"(?P<local>\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d{1,9})?)?) ?(?P<zone>Z|UTC|[+-]\d\d(:?\d\d)?)?", re.ASCII
)


def is_instant(cell: str) -> bool:
    """Whether a cell has a date and a time of day."""
    return _INSTANT.fullmatch(cell.strip().strip('"')) is not None


def in_ns(path: str | Path, name: str, lines: Sequence[int], cells: Sequence[str]) -> tuple[str, ...]:
    """The cells of a column as texts of whole ns since 1970; without a zone, of UTC.

    InputError names the line of a cell that is none.
    """
    found = [_INSTANT.fullmatch(cell.strip()) for cell in cells]
    for line, cell, one in zip(lines, cells, found):
        if one is None:
            raise InputError(path, f"line {line}, column {name}: {cell.strip()!r} is no date and time, as others are")
    matches = [one for one in found if one is not None]
    try:
        local = np.array([one["local"] for one in matches], "datetime64[ns]").astype(np.int64)
    except ValueError as error:
        raise InputError(path, f"column {name}: {error}") from None
    zones = {zone: _offset(zone) for zone in {one["zone"] for one in matches}}
    return tuple(str(int(ns) - zones[one["zone"]]) for ns, one in zip(local, matches))


def _offset(zone: str | None) -> int:
    """Ns by which clocks of the zone are ahead of UTC."""
    if zone in (None, "Z", "UTC"):
        return 0
    digits = zone[1:].replace(":", "")
    minutes = int(digits[:2]) * 60 + int(digits[2:] or 0)
    return (-1 if zone[0] == "-" else 1) * minutes * 60 * 10**9
