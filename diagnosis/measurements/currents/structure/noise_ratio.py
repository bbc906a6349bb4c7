"""How far residual currents are above the noise of the instruments."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.residual.noise.channels import is_stationary
from diagnosis.selection.design import Dataset


def joints_above_noise(residual: Array, side: Dataset, arm: Arm) -> list[int]:
    """Joints whose ``residual`` (n * rows,) exceeds the noise, the largest residual-to-noise ratio first."""
    by_joint = {joint: noise_ratio(residual, side, joint) for joint in range(1, len(arm) + 1)}
    return sorted(
        (joint for joint, value in by_joint.items() if value > LIMITS.above_noise), key=lambda joint: -by_joint[joint]
    )


def noise_ratio(residual: Array, side: Dataset, joint: int) -> float:
    """Rms of ``residual`` (n * rows,) over its noise std, at one joint, where the joint moves.

    1 for pure noise; less if the instruments are better than their stated noise.

    Only rows count in which the noise is that of the instruments. Noise correlated over longer than the initial
    standstill is underestimated; it is as large in the quietest seconds as in all others, and then the ratio is 1.
    """
    comparable = side.comparable(joint)
    if not comparable.any():
        return 1.0
    of_joint, block = residual[side.of(joint)], side.block[side.of(joint)]
    ratio = float(np.sqrt(np.mean(of_joint[comparable] ** 2)))
    far = ratio > LIMITS.far_above_noise
    return ratio if far or not is_stationary(of_joint, block, np.flatnonzero(comparable)) else min(ratio, 1.0)
