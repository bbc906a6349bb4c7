"""Units as a joint has them: N and m where it slides, and the unit of its drive command where that is not A."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_model import Arm, Joint

SLIDING = {
    "rad": "m",
    "rad/s": "m/s",
    "rad/s2": "m/s2",
    "N m": "N",
    "N m/rad": "N/m",
    "N m s/rad": "N s/m",
    "N m s2/rad2": "N s2/m2",
    "N m/rad3": "N/m3",
    "N m/rad5": "N/m5",
    "N m/s": "N/s",
    "N m/K": "N/K",
    "N m s/(rad K)": "N s/(m K)",
    "rad/(N m)": "m/N",
    "kg m2": "kg",
}
MILLI = ("A", "rad", "m")
"""Units whose small values are written in thousandths."""

QUANTITY = {"A": "current", "V": "voltage", "N m": "torque", "N": "force"}
"""What a drive's recorded signal is, by its unit."""

LONGEST = 1e5
"""Values from here on are written with an exponent."""


def unit_at(joint: Joint, unit: str, name: str = "") -> str:
    """A unit of the catalogue, which is written for revolute joints driven by currents, at a joint.

    ``name`` of the parameter: a phase stays one.
    """
    if unit in ("A", "1/A2", "1/A4"):
        own = joint.command_unit if " " not in joint.command_unit else f"({joint.command_unit})"
        return joint.command_unit if unit == "A" else unit.replace("A", own)
    if unit == "N m/A":
        return f"{'N m' if joint.revolute else 'N'}/{joint.command_unit}"
    return unit if joint.revolute or name == "phase" else SLIDING.get(unit, unit)


def recorded_quantity(joint: Joint) -> str:
    """What a recording has of a drive, by its unit: ``current``, ``torque`` or ``force``."""
    return QUANTITY.get(joint.command_unit, "drive signal")


def recorded_quantities(arm: Arm) -> str:
    """The same of all drives: ``current``; ``torque or force`` of an arm that has both."""
    return " or ".join(dict.fromkeys(map(recorded_quantity, arm.joints)))


def recorded_signals(arm: Arm) -> str:
    """The same in the plural: ``currents``, ``torques or forces``."""
    return " or ".join(f"{one}s" for one in dict.fromkeys(map(recorded_quantity, arm.joints)))


def variable_in_words(name: str, arm: Arm, joint: int | None) -> str:
    """A variable that a residual of joint ``joint`` (from 1) depends on: ``torque of joint 3`` for its current."""
    if joint is None or not name.startswith("current"):
        return name
    other = name.partition(" of joint ")[2].partition(" ")[0]
    return recorded_quantity(arm.joints[int(other or joint) - 1]) + name.removeprefix("current")


def readable(unit: str, values: Sequence[float]) -> tuple[float, str]:
    """Factor and unit in which some values are written: mA, mrad and mm where all are far below one."""
    finite = [abs(v) for v in values if np.isfinite(v)]
    return (1e3, f"m{unit}") if unit in MILLI and max(finite, default=1.0) < 0.5 else (1.0, unit)


def rounded(value: float, digits: int = 3) -> str:
    """A value to ``digits`` significant ones, without an exponent between 0.001 and 100 000."""
    short = f"{value:.{digits}g}"
    return f"{float(short):.0f}" if "e+" in short and abs(float(short)) < LONGEST else short
