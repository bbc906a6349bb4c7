"""Values that a quantity must not pass, and how they are written."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from arm_io import InputError

Side = Literal["upper", "lower"]
FORM = "must be NAME=..14 (at most), NAME=14.. (at least), NAME=10..14, NAME=14, or NAME=+50% of the first value"


@dataclass(frozen=True)
class Limit:
    """A value that a quantity must not pass: ``value`` in its unit, or a share of its first value (``relative``).

    side  upper: at most; lower: at least; None: where the first value leaves no doubt, a share by its sign
    """

    name: str
    value: float
    relative: bool = False
    side: Side | None = None


def limits_from(text: str) -> list[Limit]:
    """'joint3.coulomb=..14' and the like, see ``FORM``; InputError for anything else."""
    name, equals, numbers = text.rpartition("=")
    low, between, high = numbers.partition("..")
    if not name or not equals or name[-1] in "<>" or not (low or high):
        raise _wrong(text)
    if not between:
        value, share = _number(low, text)
        return [Limit(name, value, share, ("upper" if value > 0 else "lower") if share else None)]
    sides: list[tuple[str, Side]] = [(low, "lower"), (high, "upper")]
    limits = [Limit(name, *_number(number, text), side) for number, side in sides if number]
    if len(limits) == 2 and limits[0].relative == limits[1].relative and limits[0].value >= limits[1].value:
        raise InputError("--limit", f"the lower limit must be below the upper one (is {text!r})")
    return limits


def _number(text: str, whole: str) -> tuple[float, bool]:
    """A finite number, and whether it is a share."""
    share = text.endswith("%")
    try:
        value = float(text.removesuffix("%"))
    except ValueError:
        raise _wrong(whole) from None
    if not math.isfinite(value) or (share and value == 0):
        raise _wrong(whole)
    return value / 100 if share else value, share


def _wrong(text: str) -> InputError:
    return InputError("--limit", f"{FORM} (is {text!r})")
