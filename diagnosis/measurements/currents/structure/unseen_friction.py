"""What friction near rest may be throughout a recording, though every row of it is within its std.

How dry friction turns round at rest is on no data sheet. The std of a row near standstill is what friction lacks there
to its value while sliding (``Run.deviation``), and that is one error of one law: a joint that creeps for ten seconds
has the same in all of them. By blocks it would look like a proof.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.run import Run


def unseen_friction(runs: Sequence[Run]) -> Array:
    """(n rows,) as ``Dataset.y``: one std of what friction may have near rest against the motion, over the noise."""
    return np.concatenate([_of_run(run) for run in runs]).T.ravel()


def unseen_by_joint(runs: Sequence[Run]) -> Array:
    """(n rows, n) ``unseen_friction`` of each joint in a column of its own, where its rows are compared."""
    of_joints = np.concatenate([_of_run(run) * comparable_rows(run) for run in runs]).T
    apart: Array = of_joints[:, :, None] * np.eye(len(of_joints))[:, None, :]
    return apart.reshape(-1, len(of_joints))


def as_shown(directions: Array, residual: Array) -> Array:
    """Directions (N, n) of whitened rows, each as long as the ``residual`` (N,) shows where it is, and no longer.

    The rms of the residual over it, weighted by its square, or 1. Friction that turns as the model says leaves next to
    nothing of a std that is as large as the friction.
    """
    square = directions**2
    size = residual**2 @ square / np.maximum(np.sum(square**2, axis=0), 1e-300)
    return directions * np.sqrt(np.minimum(size, 1.0))


def _of_run(run: Run) -> Array:
    """(m, n)."""
    near_rest = np.sqrt(np.maximum(run.deviation**2 - run.instruments**2, 0.0))
    return run.whiten(np.sign(run.v) * near_rest * run.powered)
