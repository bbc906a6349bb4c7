"""By how much the motors are warmer than where the model's friction holds, as inputs of a generated system.

Straight lines between knots, as a sum over the time t from the start, with b_k by how much the slope changes at t_k:

    W(t) = W_0 + sum_k b_k max(t - t_k, 0)
"""

from __future__ import annotations

import numpy as np

from arm_model.description import Arm


def warmth_knots(arm: Arm, j: int) -> int:
    """Knots of the temperature of motor j (from 0); 0 where it, or the one at which friction holds, is not known."""
    if arm.temperatures is None or arm.joints[j].temperature is None or not arm.temperatures.degc[j]:
        return 0
    return len(arm.temperatures.time)


def warmth_numbers(arm: Arm) -> dict[str, float]:
    """The numbers ``warm{j}.start`` K, ``warm{j}.time{k}`` s and ``warm{j}.bend{k}`` K/s of all joints (from 0)."""
    numbers: dict[str, float] = {}
    for j, joint in enumerate(arm.joints):
        if not warmth_knots(arm, j) or arm.temperatures is None or joint.temperature is None:
            continue
        time, degc = np.array(arm.temperatures.time), np.array(arm.temperatures.degc[j])
        slope = np.diff(degc) / np.diff(time)
        bend = np.diff(slope, prepend=0.0, append=0.0) if len(slope) else np.zeros(1)
        numbers[f"warm{j}.start"] = float(degc[0]) - joint.temperature
        for k, (at, change) in enumerate(zip(time, bend)):
            numbers |= {f"warm{j}.time{k}": float(at), f"warm{j}.bend{k}": float(change)}
    return numbers
