"""A signal that drifts: over time in every recording, but not alike in all of them.

Time is unlike other variables. What an effect does at a position it does there in every recording; a transducer that
warms up drifts by other amounts in a longer recording, or one that begins later. No recording predicts another, but the
seconds of one predict each other.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from arm_io.types import Array
from diagnosis.selection.design import Dataset


def levels(side: Dataset, joint: int) -> Array:
    """(rows, recordings): a constant of each recording, whitened as the residual is."""
    return _of_each([np.ones((len(run.t), 1)) for run in side.runs], side, joint)


def own_lines(side: Dataset, joint: int) -> Array:
    """(rows, 2 recordings): a straight line over time in each recording, whitened as the residual is."""
    times = [np.linspace(-1.0, 1.0, len(run.t)) for run in side.runs]
    return _of_each([np.stack([np.ones_like(t), t], axis=1) for t in times], side, joint)


def _of_each(columns: list[Array], side: Dataset, joint: int) -> Array:
    return side.whitened(np.asarray(block_diag(*columns), float), joint)
