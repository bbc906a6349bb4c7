"""Variables and values as people read them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_model import Arm
from identification import recorded_quantity

MILLI = ("A", "rad", "m")
"""Units whose small values are written in thousandths."""

LONGEST = 1e5
"""Values from here on are written with an exponent."""


def variable_in_words(name: str, arm: Arm, joint: int | None) -> str:
    """A variable that a residual of joint ``joint`` (from 1) depends on: ``torque of joint 3`` for its current."""
    if joint is None or not name.startswith("current"):
        return name
    other_joint = name.partition(" of joint ")[2].partition(" ")[0]
    return recorded_quantity(arm.joints[int(other_joint or joint) - 1]) + name.removeprefix("current")


def readable(unit: str, values: Sequence[float]) -> tuple[float, str]:
    """Factor and unit in which some values are written: mA, mrad and mm where all are far below one."""
    finite = [abs(v) for v in values if np.isfinite(v)]
    return (1e3, f"m{unit}") if unit in MILLI and max(finite, default=1.0) < 0.5 else (1.0, unit)


def fall(before: float, after: float, unit: str) -> str:
    """``from 110 to 4.8 mA rms``, of an error, in a unit that suits both values."""
    factor, shown = readable(unit, (before, after))
    return f"from {rounded(factor * before)} to {rounded(factor * after)} {shown} rms"


def rounded(value: float, digits: int = 3) -> str:
    """A value to ``digits`` significant ones, without an exponent between 0.001 and 100 000."""
    short = f"{value:.{digits}g}"
    return f"{float(short):.0f}" if "e+" in short and abs(float(short)) < LONGEST else short
