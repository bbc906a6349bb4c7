"""The column t of a table: in which unit, since when, in s without losing a digit.

A laboratory's logger counts in ms, us or ns as often as in s, from its own start or from 1970. Nothing in the file says
which, and a table in ms that is taken for one in s is a thousand times too slow in everything. So what looks like
another unit is asked about.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from enum import StrEnum
from pathlib import Path

import numpy as np

from arm_io import InputError
from arm_io.types import Array


class TimeUnit(StrEnum):
    """Units in which a table may give its times."""

    S = "s"
    MS = "ms"
    US = "us"
    NS = "ns"


_DIGITS = {TimeUnit.S: 0, TimeUnit.MS: 3, TimeUnit.US: 6, TimeUnit.NS: 9}
YEAR_2000, YEAR_2100 = 946_684_800, 4_102_444_800
"""s since 1970: times between these are of the epoch, in their unit."""
SLOW = 1.0
"""s between rows: no recording of a moving arm is as slow, and counters of ms count by 1 at least."""
ENOUGH = 20
"""Rows: fewer, typed by hand, may well be seconds apart."""
SLOWEST, FURTHEST = 0.01, 0.05
"""rad/s (m/s), rad (m): an arm that goes further than the second is nowhere as slow as the first; in ms it would be."""
ROS_SECONDS = 1 << 31
_CLOCK = r"(?P<clock>\d?\d:\d\d(:\d\d([.,]\d{1,9})?)?)"
_ZONE = r" ?(?P<zone>Z|UTC|[+-]\d\d(:?\d\d)?)?"
_INSTANTS = [
    re.compile(text, re.ASCII)
    for text in (
        rf"(?P<date>\d{{4}}([-/])\d\d\2\d\d)[T ]{_CLOCK}{_ZONE}",
        rf"(?P<day>\d\d)\.(?P<month>\d\d)\.(?P<year>\d{{4}})[T ]{_CLOCK}{_ZONE}",
        rf"{_CLOCK}",
        r"(?P<seconds>\d+([.,]\d+)?) sec",
    )
]
"""2026-03-01 10:00:00.125+01:00 and the like (ISO 8601), 01.03.2026 10:00:00,125, a time of day 10:00:00.125, and what
MATLAB writes of a duration, 0.125 sec."""
_DAY_NS = 24 * 3600 * 10**9


class TimeColumn:
    """The column t, some rows after the others; the first rows decide whether its times are relative to 1970.

    unit    of the column; None: s, and InputError where it looks like another
    last    text of the file's last cell of it, "" where it is unknown
    word    what a row is called in messages
    epoch   once there are rows: s since 1970 of the first, exactly; None where the times are not of the epoch
    start_ns  wall time of t = 0 in ns, where that is known and a ROS stamp can hold all of the rows
    """

    def __init__(self, path: str | Path, unit: TimeUnit | None, last: str = "", word: str = "line") -> None:
        self._word = word
        self._path, self._unit, self._last = path, unit, last
        self._digits = _DIGITS[unit or TimeUnit.S]
        self._first = Decimal(0)
        self._before: tuple[str, float] | None = None
        self._begin = 0.0
        self.epoch: Decimal | None = None
        self.start_ns: int | None = None

    def seconds(self, lines: Sequence[int], cells: Sequence[str], t: Array) -> Array:
        """(n,) s: the times of the rows that follow; since the first row if the table has times of the epoch.

        ``cells`` hold them, on the ``lines`` of the file; t (n,): the numbers that they read as. InputError where a
        time is missing, or they do not increase strictly.
        """
        if np.isnan(t).any():
            line = lines[int(np.argmax(np.isnan(t)))]
            raise InputError(
                self._path, f"{self._word} {line}, column t: is missing; every {self._word} must have its time"
            )
        if self._before is None:
            self._begin_with(cells[0], t)
        if self._digits or self.epoch is not None:
            t = np.array([float((Decimal(cell) - self._first).scaleb(-self._digits)) for cell in cells])
        self._check_increase(lines, cells, t)
        return t

    def _begin_with(self, cell: str, t: Array) -> None:
        if self._unit is None:
            _ask(self._path, t)
        if YEAR_2000 <= t[0] * 10.0**-self._digits < YEAR_2100:
            self._first = Decimal(cell)
            self.epoch = self._first.scaleb(-self._digits)
            if self._last_time() < ROS_SECONDS:
                self.start_ns = round(self.epoch * 10**9)

    def _last_time(self) -> Decimal:
        """s since 1970."""
        try:
            return Decimal(self._last).scaleb(-self._digits)
        except (ArithmeticError, ValueError):
            return Decimal(0)

    def _check_increase(self, lines: Sequence[int], cells: Sequence[str], t: Array) -> None:
        text, before = self._before or ("", -np.inf)
        back = np.flatnonzero(np.diff(t, prepend=before) <= 0)
        if len(back):
            row = int(back[0])
            text, before = (cells[row - 1], float(t[row - 1])) if row else (text, before)
            remedy = (
                "leave out one of both rows"
                if t[row] == before
                else "where the clock was set back or restarted, import the rows before and after as two tables"
            )
            raise InputError(
                self._path,
                f"{self._word} {lines[row]}: t goes from {text} to {cells[row]}; it must increase strictly: {remedy}",
            )
        if self._before is None:
            self._begin = float(t[0])
        if t[-1] - self._begin >= ROS_SECONDS:
            spans = f"t spans {t[-1] - self._begin:.3g} s"
            raise InputError(self._path, f"{spans}; is it in s? Give --time-unit s, ms, us or ns")
        self._before = cells[-1], float(t[-1])


def ask_of_speeds(path: str | Path, t: Array, q: Array) -> None:
    """InputError that asks for the unit of t (n,) if joints at q (n, J) rad (m) move a thousand times too slowly.

    A logger of 2 kHz counts milliseconds in steps of 0.5, which could be seconds as well.
    """
    whole = np.isfinite(q).all(axis=1)
    if whole.sum() < ENOUGH or (travel := np.ptp(q[whole], axis=0)).max() < FURTHEST:
        return
    fastest = float(np.max(np.abs(np.diff(q[whole], axis=0)) / np.diff(t[whole])[:, None]))
    if fastest < SLOWEST:
        raise InputError(
            path,
            f"no joint moves faster than {fastest:.1g} rad/s (m/s) although one goes {travel.max():.2g} rad (m) far; "
            "is t in s? Give --time-unit s, ms, us or ns",
        )


def _ask(path: str | Path, t: Array) -> None:
    """InputError, which asks for the unit, where times do not look like s."""
    likely = [unit for unit, digits in _DIGITS.items() if YEAR_2000 <= t[0] * 10.0**-digits < YEAR_2100]
    if likely and likely[0] is not TimeUnit.S:
        raise InputError(
            path, f"t begins at {t[0]:.0f}, as {likely[0]} since 1970 do; give --time-unit s, ms, us or ns"
        )
    if len(t) >= ENOUGH and (step := float(np.median(np.diff(t)))) >= SLOW:
        raise InputError(path, f"t goes by {step:g} from row to row; is it in s? Give --time-unit s, ms, us or ns")


def is_instant(cell: str) -> bool:
    """Whether a cell has a date and a time of day, a time of day alone, or a duration with its unit."""
    return _instant(cell.strip().strip('"')) is not None


def in_ns(
    path: str | Path, name: str, lines: Sequence[int], cells: Sequence[str], before: int | None = None
) -> tuple[str, ...]:
    """The cells of a column as texts of whole ns since 1970, or since midnight or 0 where they have no date.

    Without a zone they are of UTC. Times of day go on after midnight; ``before``: ns of the row before the first one.
    InputError names the line of a cell that is none.
    """
    found = [_instant(cell.strip()) for cell in cells]
    for line, cell, one in zip(lines, cells, found):
        if one is None or found[0] is None or one.re is not found[0].re:
            raise InputError(path, f"line {line}, column {name}: {cell.strip()!r} is no date and time, as others are")
    matches = [one.groupdict() for one in found if one is not None]
    try:
        local = np.array([_local(one) for one in matches], "datetime64[ns]").astype(np.int64)
    except ValueError as error:
        raise InputError(path, f"column {name}: {error}") from None
    zones = {zone: _offset(zone) for zone in {one.get("zone") for one in matches}}
    ns = local - np.array([zones[one.get("zone")] for one in matches], dtype=np.int64)
    if not {"date", "year", "seconds"} & set(matches[0]):
        first = int(ns[0]) if before is None else before
        days = np.cumsum(np.diff(ns, prepend=first % _DAY_NS) < -_DAY_NS // 2) + first // _DAY_NS
        ns = ns + days * _DAY_NS
    return tuple(map(str, ns.tolist()))


def _instant(cell: str) -> re.Match[str] | None:
    return next((match for one in _INSTANTS if (match := one.fullmatch(cell))), None)


def _local(parts: dict[str, str | None]) -> str | np.datetime64:
    """The local time as numpy reads it; 1970-01-01 where there is no date."""
    if (seconds := parts.get("seconds")) is not None:
        return np.datetime64(int(Decimal(seconds.replace(",", ".")).scaleb(9)), "ns")
    written = (parts.get("date") or "").replace("/", "-")
    german = f"{parts['year']}-{parts['month']}-{parts['day']}" if parts.get("year") else ""
    clock = str(parts["clock"]).replace(",", ".")
    return f"{written or german or '1970-01-01'}T{clock.zfill(len(clock) + clock.find(':') % 2)}"


def _offset(zone: str | None) -> int:
    """Ns by which clocks of the zone are ahead of UTC."""
    if zone in (None, "Z", "UTC"):
        return 0
    digits = zone[1:].replace(":", "")
    minutes = int(digits[:2]) * 60 + int(digits[2:] or 0)
    return (-1 if zone[0] == "-" else 1) * minutes * 60 * 10**9
