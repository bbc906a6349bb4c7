"""Angles of an encoder between its steps.

A joint that creeps passes a step every few rows. Differences of its angles are then bursts: none for some rows, and the
speed of a whole step in one. A filter leaves the bursts where they are slower than its band, and what depends on the
speed by a curve, as friction near rest does, is not that of their mean. At a step itself the angle is known far better
than to a step: it is halfway between both readings.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array


def between_steps(q: Array) -> Array:
    """(m, n) angles q (m, n) of equally spaced rows, straight between the instants at which they change.

    A row that differs from both of its neighbours is left as it is: angles that change in every row are unchanged.
    """
    return np.stack([_of_joint(angle) for angle in q.T], axis=1)


def _of_joint(q: Array) -> Array:
    change = np.flatnonzero(np.diff(q))
    if not 0 < len(change) < len(q) - 1:
        return q
    row = np.arange(len(q))
    moving = row[1:-1][(q[1:-1] != q[:-2]) & (q[1:-1] != q[2:])]
    # the outermost readings are held from a row outside
    at = np.concatenate([[-1], change + 0.5, moving, [len(q)]])
    angle = np.concatenate([q[:1], (q[change] + q[change + 1]) / 2.0, q[moving], q[-1:]])
    order = np.argsort(at, kind="stable")
    return np.asarray(np.interp(row, at[order], angle[order]), float)
