"""The column t of a table: in which unit, since when, in s without losing a digit.

A laboratory's logger counts in ms, us or ns as often as in s, from its own start or from 1970. Nothing in the file says which, and a
table in ms that is taken for one in s is a thousand times too slow in everything. So what looks like another unit is asked about.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
ROS_SECONDS = 1 << 31


@dataclass(frozen=True)
class Times:
    """Times of the rows: t (n,) s, as the table has them, or since the first row where the table's are of the epoch.

    epoch  s since 1970 of the first row, exactly; None where the table's times are not of the epoch
    """

    t: Array
    epoch: Decimal | None = None

    @property
    def start_ns(self) -> int | None:
        """Wall time of t = 0, where that is known and a ROS stamp can hold all of the rows."""
        if self.epoch is None or self.epoch + Decimal(float(self.t[-1])) >= ROS_SECONDS:
            return None
        return round(self.epoch * 10**9)


def times_of(path: str | Path, lines: Sequence[int], cells: Sequence[str], t: Array, unit: TimeUnit | None) -> Times:
    """The times in ``cells``, which read as the numbers ``t`` (n,). ``lines``: where they stand.

    unit  None: s, and InputError where they look like another unit
    Raises InputError where a time is missing, or they do not increase strictly.
    """
    if np.isnan(t).any():
        line = lines[int(np.argmax(np.isnan(t)))]
        raise InputError(path, f"line {line}, column t: is missing; every line wants its time")
    if unit is None:
        _ask(path, t)
    digits = _DIGITS[unit or TimeUnit.S]
    of_epoch = YEAR_2000 <= t[0] * 10.0**-digits < YEAR_2100
    times = Times(t)
    if digits or of_epoch:
        exact = [Decimal(cell) for cell in cells]
        first = exact[0] if of_epoch else Decimal(0)
        since = np.array([float((value - first).scaleb(-digits)) for value in exact])
        times = Times(since, first.scaleb(-digits) if of_epoch else None)
    _check_increase(path, lines, cells, times.t)
    return times


def _ask(path: str | Path, t: Array) -> None:
    """InputError, which asks for the unit, where times do not look like s."""
    likely = [unit for unit, digits in _DIGITS.items() if YEAR_2000 <= t[0] * 10.0**-digits < YEAR_2100]
    if likely and likely[0] is not TimeUnit.S:
        raise InputError(
            path, f"t begins at {t[0]:.0f}, as {likely[0]} since 1970 do; give --time-unit s, ms, us or ns"
        )
    step = float(np.median(np.diff(t)))
    if step >= SLOW and len(t) >= ENOUGH:
        raise InputError(path, f"t goes by {step:g} from row to row; is it in s? Give --time-unit s, ms, us or ns")


def _check_increase(path: str | Path, lines: Sequence[int], cells: Sequence[str], t: Array) -> None:
    back = np.flatnonzero(np.diff(t) <= 0)
    if len(back):
        row = int(back[0]) + 1
        raise InputError(
            path, f"line {lines[row]}: t goes from {cells[row - 1]} to {cells[row]}; it must increase strictly"
        )
    if t[-1] - t[0] >= ROS_SECONDS:
        raise InputError(path, f"t spans {t[-1] - t[0]:.3g} s; is it in s? Give --time-unit s, ms, us or ns")
