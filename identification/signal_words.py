"""What the recorded signals of an arm's drives are called, by their unit: currents, torques, forces."""

from __future__ import annotations

from arm_model import Arm, Joint

QUANTITY = {"A": "current", "V": "voltage", "N m": "torque", "N": "force"}
"""What a drive's recorded signal is, by its unit."""


def recorded_quantity(joint: Joint) -> str:
    """What a recording has of a drive, by its unit: ``current``, ``torque`` or ``force``."""
    return QUANTITY.get(joint.command_unit, "drive signal")


def recorded_quantities(arm: Arm) -> str:
    """The same of all drives: ``current``; ``torque or force`` of an arm that has both."""
    return " or ".join(dict.fromkeys(map(recorded_quantity, arm.joints)))


def recorded_signals(arm: Arm) -> str:
    """The same in the plural: ``currents``, ``torques or forces``."""
    return " or ".join(f"{one}s" for one in dict.fromkeys(map(recorded_quantity, arm.joints)))
