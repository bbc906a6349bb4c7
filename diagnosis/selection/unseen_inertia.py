"""What sampling may put onto a joint's own acceleration where nothing shows how often setpoints come.

A servo follows a broken line of setpoints, one every T s. At each corner the speed asked for jumps by a T, and by its
gain k on speed a saw of the current answers, whose first line has the amplitude k a T / pi of the joint's own inertia.
Rows that come as often as setpoints show this line at 0 Hz: as an inertia that is not there. Where a model has no
controller, a log no demands and the currents no line, rows may come that often, and no line that is seen bounds what
folds (``identification.preprocessing.setpoint_ripple``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from diagnosis.residual.filters import rate_of
from diagnosis.residual.run import Run
from diagnosis.selection.design import Columns, Dataset

FOLDS = 2.5
"""Hz: share of a joint's own inertia that may fold, times the rate of the rows.

A gain on speed of 60/s, and a filter before the rows that leaves an eighth of a line at their rate: one of second order
at 0.35 times that. 2 % at 125 Hz; measured, of gains of 29 to 48/s, up to 1.0 %.
"""


def unseen_inertia(runs: Sequence[Run]) -> Array:
    """(n rows,) as ``Dataset.y``: what may have folded onto the acceleration of every joint, over the noise."""
    return np.concatenate([_of_run(run) for run in runs]).T.ravel()


def _of_run(run: Run) -> Array:
    """(m, n): 0 of a recording whose setpoints are known, or show themselves."""
    if not setpoints_unknown(run):
        return np.zeros_like(run.a)
    return np.asarray(run.whiten(own_inertia(run)) * FOLDS / rate_of(run.raw[0]))


def setpoints_unknown(run: Run) -> bool:
    """Whether nothing shows how often the setpoints of a recording come, so that it may be once per row."""
    return run.arm.controller is None and not run.setpoints.period and run.powered


def own_inertia(run: Run) -> Array:
    """(m, n) A that accelerate each joint with all that it carries and its rotor."""
    return np.asarray(_inertias(run) * run.a / run.arm.joint_array("drive_constant"))


def mean_inertia(run: Run) -> Array:
    """(m, n) A: the same with the mean inertia of each joint, as a servo of constant gains answers its setpoints."""
    return np.asarray(np.mean(_inertias(run), axis=0) * run.a / run.arm.joint_array("drive_constant"))


def _inertias(run: Run) -> Array:
    """(m, n) kg m2 (kg)."""
    rotors = np.array([joint.ratio**2 * joint.rotor_inertia for joint in run.arm.joints])
    return np.asarray(run.inertia + rotors)


def explained(unseen: Array, columns: Columns, held_out: Dataset) -> Array:
    """(n,) how much of ``unseen`` (n rows,) columns would explain at each joint, as a fall of the squared residual."""
    energies = np.zeros(len(unseen) // held_out.rows)
    for joint in range(1, len(energies) + 1):
        rows = held_out.of(joint)
        if columns.where.start <= rows.start and rows.stop <= columns.where.stop and unseen[rows].any():
            x = columns.x[rows.start - columns.where.start : rows.stop - columns.where.start]
            basis, size, _ = np.linalg.svd(x / np.maximum(np.linalg.norm(x, axis=0), 1e-300), full_matrices=False)
            components = basis[:, size > 1e-3].T @ unseen[rows]
            energies[joint - 1] = float(components @ components)
    return energies
