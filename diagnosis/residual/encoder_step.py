"""The step of an encoder or converter, from its samples alone."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array

FEWEST = 10
"""Distances between values that decide whether these lie on a lattice."""
OFF_LATTICE = 0.05
"""Of a step: values that are off by less are on it."""


def encoder_step(values: Array) -> float:
    """Smallest step that occurs often in (m,) samples, in their unit; 0 where they never change.

    Of samples whose noise exceeds their step, it is no more than the noise.
    """
    steps = np.abs(np.diff(values))
    steps = steps[steps > 1e-9]
    return float(np.quantile(steps, 0.02)) if len(steps) else 0.0


def lattice_step(values: Array) -> float:
    """Spacing of the values that (m,) samples take, in their unit; 0 where they lie on no lattice.

    How many steps pass between two rows does not matter, as it does to ``encoder_step``, as long as a motion comes back
    to the same angles often enough for neighbouring values.
    """
    apart = np.diff(np.unique(values))
    apart = apart[apart > 1e-12 * max(float(np.abs(values).max(initial=0.0)), 1e-300)]
    if len(apart) < FEWEST:
        return 0.0
    step = float(np.median(apart[apart < 1.5 * np.quantile(apart, 0.02)]))
    whole = np.abs(apart / step - np.rint(apart / step)) < OFF_LATTICE
    return step if np.mean(whole) > 0.9 else 0.0
