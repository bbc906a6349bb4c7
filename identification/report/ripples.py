"""Ripples in words: of what order and size, how well known, and why a wave that stood out is not in the model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from arm_report.numbers import with_two_std

if TYPE_CHECKING:
    from identification.result import Identification


def sentences(result: Identification) -> list[str]:
    """One per wave that stood out; where ripples were looked for and none did, that."""
    if "ripples" not in result.extra:
        return []
    found = result.extra["ripples"]
    return [_said(result, one) for one in found] or ["ripples: none found in the residual"]


def _said(result: Identification, one: Mapping[str, Any]) -> str:
    joint, sizes = result.arm.joints[one["joint"] - 1], one["parameters"]
    unit, order = result.torque_unit(one["joint"] - 1), sizes["order"]["value"]
    per_joint = order * joint.ratio
    cycles = f"{per_joint:.4g} cycles per turn" if joint.revolute else f"{per_joint / (2 * np.pi):.4g} cycles per m"
    if joint.revolute and one["turn"] == "motor" and joint.ratio != 1.0:
        cycles = f"{order:.4g} cycles per turn of the motor"
    head = f"ripple of joint {one['joint']}, {cycles}"
    if not one["stays"]:
        return f"{head}: not in the model ({one['why']})"
    torque, phase = (
        f"{with_two_std(sizes[name]['value'], sizes[name]['std'])} {of}"
        for name, of in (("torque", unit), ("phase", "rad"))
    )
    return f"{head}: {torque}, phase {phase} ({one['why']})"
