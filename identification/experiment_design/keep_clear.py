"""Motions that keep clear of the arm's space: start poses that do, and how far a motion about one may go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_clearance import Pairs, nearest
from arm_io import InputError
from arm_io.types import Array
from experiment import Demand

RESERVE = 1e-3
"""m beyond what must be kept, so that a check of the same motion agrees."""
DRAWN = 64
"""Start poses that are drawn for a candidate; the first that is clear, and that the motors hold, is taken."""
SHRINK = 0.8
"""Factor by which a motion is shrunk about its start pose, again and again until it is clear."""
SMALLEST = 0.1
"""Share of a motion at which it is given up."""


def clear_poses(pairs: Pairs, poses: Array) -> NDArray[np.bool_]:
    """Which of the poses (k, n) are clear."""
    return np.asarray(_room(pairs, poses) >= RESERVE)


def clear_share(pairs: Pairs, start: Array, way: Array) -> float:
    """The largest factor with which a motion ``way`` (rows, n) about ``start`` (n,) is clear at its rows; 0 if none."""
    if not _room(pairs, start[None])[0] >= RESERVE:
        return 0.0
    share = 1.0
    while share >= SMALLEST:
        if _room(pairs, start + share * way).min() >= RESERVE:
            return share
        share *= SHRINK
    return 0.0


def is_clear(demand: Demand, pairs: Pairs) -> bool:
    """Whether a motion is clear at every instant."""
    distances = nearest(demand, pairs)
    return distances is None or distances.room >= RESERVE


def none_is_clear(pairs: Pairs, low: Array, high: Array) -> InputError:
    """A sentence that says why there is no motion: what most poses between low and high (n,) collide with."""
    poses = low + (high - low) * np.random.default_rng(0).random((DRAWN, len(low)))
    room = pairs.clearance(poses) - pairs.required()
    blocked = room < RESERVE
    one, other = pairs.names()[int(np.argmax(blocked.sum(axis=0)))]
    return InputError(
        "excite",
        f"no motion keeps clear: {blocked.any(axis=1).sum()} of {DRAWN} start poses within the limits do not, most "
        f"often {one} and {other}; narrow the limits of position to where the arm is clear, or correct the space",
    )


def _room(pairs: Pairs, q: Array) -> Array:
    """(k,) m that are left in each pose."""
    return np.asarray((pairs.clearance(q) - pairs.required()).min(axis=1, initial=np.inf))
