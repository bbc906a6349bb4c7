"""The equations of motion as rows of a linear regression: Y(q, q', q'') delta = torque, for all runs of an identification.

Row by row through the same parallel filter on both sides; rows that rest on samples which cannot be trusted are left out and counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm
from arm_model.regressor import parameter_names, parameter_vector, regressor
from identification.base_parameters import BaseParameters, base_parameters
from identification.signals import Motion, parallel_filter, parallel_rows, parallel_window

Array = NDArray[np.float64]
Friction = Literal["symmetric", "asymmetric"]


@dataclass(frozen=True)
class Equations:
    """columns (rows, p) of the standard parameters ``names``, torque (rows,) N m or N, and where each row comes from:
    joint (rows,) from 0, run (rows,) from 0, t (rows,) s within the run. Rows of one run and joint follow in time."""

    columns: Array
    torque: Array
    joint: NDArray[np.intp]
    run: NDArray[np.intp]
    t: Array
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.torque)

    def of(self, rows: NDArray[np.bool_]) -> Equations:
        """Only those rows."""
        return Equations(
            self.columns[rows], self.torque[rows], self.joint[rows], self.run[rows], self.t[rows], self.names
        )


def column_names(arm: Arm, friction: Friction) -> list[str]:
    """Names of ``model_columns``: the regressor's, friction as asked for, rotors only where the model has one.

    symmetric   viscous, coulomb, offset: with a constant offset, Coulomb friction may differ by direction
    asymmetric  viscous_positive, viscous_negative, coulomb_positive, coulomb_negative; an offset could not be told from these
    """
    return [name for name in parameter_names(arm, friction=friction) if not _left_out(arm, name, friction)]


def model_columns(arm: Arm, q: Array, qd: Array, qdd: Array, friction: Friction = "symmetric") -> Array:
    """(N, n, p) regressor with the columns ``column_names(arm, friction)``."""
    full, names = regressor(arm, q, qd, qdd, friction=friction)
    return full[:, :, [k for k, name in enumerate(names) if not _left_out(arm, name, friction)]]


def model_values(arm: Arm, friction: Friction = "symmetric") -> Array:
    """(p,) the arm's own values of the parameters ``column_names(arm, friction)``.

    While a joint moves, no one can tell a constant torque from a difference of the two Coulomb magnitudes: with symmetric friction the
    offset carries half of that difference, with asymmetric friction the magnitudes carry the offset.
    """
    values = []
    for name, value in zip(parameter_names(arm, friction=friction), parameter_vector(arm, friction=friction)):
        if _left_out(arm, name, friction):
            continue
        head, _, rest = name.partition(".")
        joint = arm.joints[int(head.removeprefix("joint")) - 1] if head.startswith("joint") else None
        if joint is not None and rest == "offset":
            value += joint.ratio * (joint.coulomb[0] - joint.coulomb[1]) / 2
        elif joint is not None and rest in ("coulomb_positive", "coulomb_negative"):
            value += joint.ratio * joint.offset * (1 if rest.endswith("positive") else -1)
        values.append(value)
    return np.array(values)


def _left_out(arm: Arm, name: str, friction: Friction) -> bool:
    head, _, rest = name.partition(".")
    if rest == "offset":
        return friction == "asymmetric"
    # Without a rotor in the model, its inertia is part of what the joint moves.
    return rest == "rotor_inertia" and arm.joints[int(head.removeprefix("joint")) - 1].rotor_inertia == 0.0


def structural_base(arm: Arm, friction: Friction = "symmetric", *, states: int = 0, seed: int = 1) -> BaseParameters:
    """What any motion of this arm could show: base parameters from random states within its limits."""
    names = column_names(arm, friction)
    random = np.random.default_rng(seed)
    count = states or 4 * len(names)
    limits = [joint.limits or ((-np.pi, np.pi) if joint.revolute else (-1.0, 1.0)) for joint in arm.joints]
    q = random.uniform([low for low, _ in limits], [high for _, high in limits], (count, len(arm)))
    qd, qdd = random.uniform(-2, 2, q.shape), random.uniform(-5, 5, q.shape)
    columns = model_columns(arm, q, qd, qdd, friction)
    return base_parameters(columns.reshape(-1, len(names)), names)


def equations(arm: Arm, motions: Sequence[Motion], friction: Friction = "symmetric") -> Equations:
    """All usable rows of all runs."""
    parts = [_run_equations(arm, motion, run, friction) for run, motion in enumerate(motions)]
    names = tuple(column_names(arm, friction))
    return Equations(
        np.concatenate([part.columns for part in parts]),
        np.concatenate([part.torque for part in parts]),
        np.concatenate([part.joint for part in parts]),
        np.concatenate([part.run for part in parts]),
        np.concatenate([part.t for part in parts]),
        names,
    )


def _run_equations(arm: Arm, motion: Motion, run: int, friction: Friction) -> Equations:
    t, trusted = parallel_rows(motion)
    columns = filtered_columns(arm, motion, motion.q, motion.qd, motion.qdd, friction)
    torque = parallel_filter(motion, motion.torque)
    joint, row = np.nonzero(trusted.T)
    names = tuple(column_names(arm, friction))
    return Equations(columns[row, joint], torque[row, joint], joint, np.full(len(row), run), t[row], names)


def filtered_columns(arm: Arm, motion: Motion, q: Array, qd: Array, qdd: Array, friction: Friction) -> Array:
    """(k, n, p) ``model_columns`` on the grid of ``motion`` through its parallel filter, a stretch at a time to save memory."""
    window, step = parallel_window(motion)
    kept = (len(motion.t) - window) // step + 1
    stretch = max(1, 4 * window // step)
    parts = []
    for first in range(0, kept, stretch):
        last = min(first + stretch, kept)
        rows = slice(first * step, (last - 1) * step + window)
        parts.append(parallel_filter(motion, model_columns(arm, q[rows], qd[rows], qdd[rows], friction)))
    return np.concatenate(parts)
