"""The equations of motion as rows of a linear regression: Y(q, q', q'') delta + rest = torque, for all runs.

``rest`` is what an arm with effects shows beyond its columns times its parameters
(``identification.regression.effect_columns``); without effects it is nothing. Through the same parallel filter on both
sides; samples for which they do not hold (``signals.equation_weight``) are zero on both sides before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from identification.preprocessing.setpoint_ripple import drifting
from identification.preprocessing.signals import (
    Motion,
    equation_rows,
    equation_weight,
    parallel_filter,
    parallel_window,
    sliding_rows,
)
from identification.regression.base_parameters import BaseParameters
from identification.regression.effect_columns import Samples, effect_columns, effect_parameters, shown_torque
from identification.regression.model_parameters import Friction, column_names, described_columns, model_values
from identification.selection import BLOCK_SECONDS

STRETCH = 4096
"""Rows whose columns are in memory together, at least: fewer take as long."""
PER_ROW = ("columns", "torque", "joint", "run", "t", "rest", "systematic", "sliding")


@dataclass(frozen=True)
class Equations:
    """columns (rows, p) of the standard parameters ``names``, torque (rows,) N m or N, and where each row comes from.

    Joint (rows,) from 0, run (rows,) from 0, t (rows,) s within the run. Rows of one run and joint follow in time. rest
    (rows,): the part of the torque that no column carries; None: nothing. systematic (rows, s): errors that the torques
    may have and no residual shows, each one standard deviation of its own cause. sliding (rows,): those that rest on
    samples alone in which the direction of motion is known; None: all.
    """

    columns: Array
    torque: Array
    joint: NDArray[np.intp]
    run: NDArray[np.intp]
    t: Array
    names: tuple[str, ...]
    rest: Array | None = None
    systematic: Array | None = None
    sliding: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.torque)

    def of(self, rows: NDArray[np.bool_]) -> Equations:
        """Only those rows."""
        given = {name: value[rows] for name in PER_ROW if (value := getattr(self, name)) is not None}
        return replace(self, **given)

    def speed(self) -> Array:
        """(rows,) rad/s (m/s) of the joint of each row, as its columns of viscous friction have it."""
        speed = np.zeros(len(self))
        for k, name in enumerate(self.names):
            joint, _, parameter = name.partition(".")
            if parameter.startswith("viscous"):
                own = self.joint == int(joint.removeprefix("joint")) - 1
                speed[own] += self.columns[own, k]
        return np.abs(speed)

    def blocks(self) -> NDArray[np.intp]:
        """(rows,) number of the run and second of each row, from 0."""
        _, block = np.unique(np.stack([self.run, self.t // BLOCK_SECONDS]), axis=1, return_inverse=True)
        return np.asarray(block.ravel(), np.intp)


def joined(parts: Sequence[Equations]) -> Equations:
    """The rows of several sets of recordings, those of each as further runs, without ``systematic`` errors."""
    first = np.cumsum([0, *(int(part.run.max(initial=-1)) + 1 for part in parts)])
    numbered = [replace(part, run=part.run + start) for part, start in zip(parts, first)]
    given: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in numbered])
        for name in PER_ROW
        if name != "systematic" and all(getattr(part, name) is not None for part in numbered)
    }
    return replace(parts[0], systematic=None, **given)


def equations(
    arm: Arm, motions: Sequence[Motion], friction: Friction = "symmetric", base: BaseParameters | None = None
) -> Equations:
    """The rows of all runs.

    ``rest`` is what the arm shows beyond the columns of its ``base`` parameters (default: of all).
    """
    (rows,) = equations_of(arm, [motions], friction, base)
    return rows


def equations_of(
    arm: Arm, views: Sequence[Sequence[Motion]], friction: Friction, base: BaseParameters | None
) -> list[Equations]:
    """``equations`` of several views of the same runs, which differ in the rows that are trusted.

    The regressor is computed once for all of them.
    """
    found = []
    parts = [_run_equations(arm, same, run, friction) for run, same in enumerate(zip(*views))]
    for motions, parts_of_view in zip(views, zip(*parts)):
        columns, torque, joint, run, t = (np.concatenate(part) for part in zip(*parts_of_view))
        rows = Equations(columns, torque, joint, run, t, tuple(column_names(arm, friction)))
        sliding = np.concatenate([sliding_rows(motion).T[equation_rows(motion)[1].T] for motion in motions])
        rows = replace(rows, systematic=_systematic(rows, motions), sliding=sliding)
        found.append(with_effects(rows, arm, arm, motions, friction, base))
    return found


def _systematic(rows: Equations, motions: Sequence[Motion]) -> Array | None:
    """(rows, s) torque that aliased setpoint ripple may have added, for each joint and run; None: nothing.

    One column is constant along the run, others follow two clocks that drift apart.
    """
    found = []
    for run, motion in enumerate(motions):
        if motion.folded is None:
            continue
        unseen = drifting(motion.folded, motion.t) * equation_weight(motion)[:, None]
        added = parallel_filter(motion, unseen)
        joint, row = np.nonzero(equation_rows(motion)[1].T)
        for j in np.flatnonzero(motion.folded.any(axis=0)):
            columns = np.zeros((len(rows), 2))
            columns[rows.run == run] = np.where((joint == j)[:, None], added[row, :, j], 0.0)
            found.append(columns)
    return np.concatenate(found, axis=1) if found else None


def _run_equations(
    arm: Arm, views: Sequence[Motion], number: int, friction: Friction
) -> list[tuple[Array, Array, NDArray[np.intp], NDArray[np.intp], Array]]:
    """columns of links and drives, torque, joint, run and t of one run's rows, for each view of it."""
    found = []
    for motion, columns in zip(views, _filtered(arm, views, views[0], friction)):
        t, trusted = equation_rows(motion)
        torque = parallel_filter(motion, motion.torque * equation_weight(motion))
        joint, row = np.nonzero(trusted.T)
        found.append((columns[row, joint], torque[row, joint], joint, np.full(len(row), number, np.intp), t[row]))
    return found


def described_rows(arm: Arm, motions: Sequence[Motion], moved: Sequence[Motion], friction: Friction) -> Array:
    """(rows, p - e) ``described_columns`` of ``equations`` of ``motions``, for positions ``moved`` on their grids."""
    parts = []
    for motion, other in zip(motions, moved):
        (columns,) = _filtered(arm, [motion], other, friction)
        joint, row = np.nonzero(equation_rows(motion)[1].T)
        parts.append(columns[row, joint])
    return np.concatenate(parts)


def _filtered(arm: Arm, views: Sequence[Motion], moved: Motion, friction: Friction) -> list[Array]:
    """(k, n, p - e) ``described_columns`` of the motion ``moved``, through the parallel filter of each view.

    All ``views`` are of one run, which is processed in stretches to save memory.
    """
    motion = views[0]
    window, step = parallel_window(motion)
    weights = [equation_weight(view)[..., None] for view in views]
    kept = (len(motion.t) - window) // step + 1
    stretch = max(1, max(4 * window, STRETCH) // step)
    parts: list[list[Array]] = [[] for _ in views]
    for first in range(0, kept, stretch):
        last = min(first + stretch, kept)
        rows = slice(first * step, (last - 1) * step + window)
        unfiltered = described_columns(arm, moved.q[rows], moved.qd[rows], moved.qdd[rows], friction)
        for part, weight in zip(parts, weights):
            part.append(parallel_filter(motion, unfiltered * weight[rows]))
    return [np.concatenate(part) for part in parts]


def with_effects(
    rows: Equations,
    arm: Arm,
    model: Arm,
    motions: Sequence[Motion],
    friction: Friction,
    base: BaseParameters | None,
    moved: Sequence[Motion] | None = None,
) -> Equations:
    """``rows`` with the columns of the effects at the values of ``arm``, and the ``rest``.

    ``model``: that of the readings (``shown_torque``); ``moved``: other positions on the grids of ``motions``,
    simulated ones.
    """
    if not arm.effects:
        return rows
    parts = [_effect_rows(arm, model, motion, other) for motion, other in zip(motions, moved or motions)]
    found = np.concatenate(parts)
    values = model_values(arm, friction)
    effects = len(effect_parameters(arm))
    described = rows.columns[:, : len(values) - effects]
    columns = np.concatenate([described, found[:, 1:]], axis=1)
    linear = columns @ values if base is None else columns[:, base.kept] @ (base.grouping @ values)
    return replace(rows, columns=columns, rest=found[:, 0] - linear)


def _effect_rows(arm: Arm, model: Arm, motion: Motion, moved: Motion) -> Array:
    """(rows of this run, 1 + e): the torque that the arm shows, then its derivatives by the effects' parameters."""
    samples = Samples(moved.q, moved.qd, moved.qdd, motion.t)
    arm = replace(arm, temperatures=motion.temperatures)
    shown = shown_torque(arm, model, samples)
    columns = effect_columns(arm, model, samples, shown)
    joint, row = np.nonzero(equation_rows(motion)[1].T)
    both = np.concatenate([shown[..., None], columns], axis=2) * equation_weight(motion)[..., None]
    return np.asarray(parallel_filter(motion, both)[row, joint])


def measured_rows(motions: Sequence[Motion]) -> Equations:
    """The rows of ``equations`` without columns: measured torques, and where they come from."""
    parts = []
    for run, motion in enumerate(motions):
        t, usable = equation_rows(motion)
        joint, row = np.nonzero(usable.T)
        torque = parallel_filter(motion, motion.torque * equation_weight(motion))[row, joint]
        sliding = sliding_rows(motion)[row, joint]
        parts.append((torque, joint, np.full(len(row), run, np.intp), t[row], sliding))
    torque, joint, run_of, t, sliding = (np.concatenate(part) for part in zip(*parts))
    return Equations(np.empty((len(torque), 0)), torque, joint, run_of, t, (), sliding=sliding)


def shown_rows(arm: Arm, model: Arm, motions: Sequence[Motion]) -> Array:
    """(rows,) the torque that a recording of ``arm`` shows on these motions, as the rows of ``equations``."""
    parts = []
    for motion in motions:
        joint, row = np.nonzero(equation_rows(motion)[1].T)
        warm = replace(arm, temperatures=motion.temperatures)
        shown = shown_torque(warm, model, Samples(motion.q, motion.qd, motion.qdd, motion.t))
        parts.append(parallel_filter(motion, shown * equation_weight(motion))[row, joint])
    return np.concatenate(parts)
