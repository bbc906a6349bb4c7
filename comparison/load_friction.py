"""Friction that grows with the load of a gear: one column per joint, (|load| - mean |load|) sign(velocity).

The load is the torque of the links by the model; its mean over all recordings is subtracted, so that a friction curve
means friction at the mean load in each. Without this column, friction that became load-dependent would look like
changed masses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE
from arm_model.system import rigid_torque_along
from identification.preprocessing.signals import Motion

EFFECT = CATALOGUE["load_friction"]
LEAST = 0.02
"""Spread of the load over its mean; of a load that is nearly constant, its friction is part of the curve."""


def load_of(arm: Arm, motion: Motion) -> Array:
    """(m, J) N m (N) on the links, of a motion."""
    return np.abs(rigid_torque_along(arm, motion.q, motion.qd, motion.qdd))


def mean_loads(arm: Arm, motions: Sequence[Motion]) -> Array:
    """(J,) mean of |load| over all motions; NaN where it hardly varies, or the model has this effect."""
    loads = [load_of(arm, motion) for motion in motions]
    mean = np.mean([load.mean(axis=0) for load in loads], axis=0)
    std = np.min([load.std(axis=0) for load in loads], axis=0)
    modelled = [any(term.name == EFFECT.name and term.joint == j + 1 for term in arm.effects) for j in range(len(arm))]
    return np.where((std > LEAST * mean) & (std > 0) & ~np.array(modelled), mean, np.nan)


def loaded_joints(means: Array) -> NDArray[np.intp]:
    """(l,) joints (from 0) that have the column."""
    return np.flatnonzero(np.isfinite(means))


def load_columns(arm: Arm, motion: Motion, means: Array) -> Array:
    """(m, l) torque of each loaded joint per unit coefficient."""
    joints = loaded_joints(means)
    load = load_of(arm, motion)[:, joints] - means[joints]
    return np.asarray(load * np.sign(motion.qd[:, joints]))
