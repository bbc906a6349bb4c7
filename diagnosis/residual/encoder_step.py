"""The step of an encoder or converter, from its samples alone."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array


def encoder_step(values: Array) -> float:
    """Smallest step that occurs often in (m,) samples, in their unit; 0 where they never change.

    Of samples whose noise exceeds their step, it is no more than the noise.
    """
    steps = np.abs(np.diff(values))
    steps = steps[steps > 1e-9]
    return float(np.quantile(steps, 0.02)) if len(steps) else 0.0
