"""Rows of the wrench on a floating base, filtered alike on both sides.

Columns and signs: ``arm_model.moving_base.regressor``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.moving_base import hull_wrench, nominal_wrench_parameters, wrench_columns
from identification.floating_base.rows import BaseRun


@dataclass(frozen=True)
class Rows:
    """Compared rows of runs, one after the other: k rows of the six degrees of freedom.

    names    (p,) of the parameters; columns (k, 6, p): wrench per unit of each, N and N m
    known    (k, 6): wrench that the rigid vehicle takes
    block    (k,) number of the block of each row, from 0
    t        (k,) s; run (k,) number of its run
    """

    names: tuple[str, ...]
    columns: Array
    known: Array
    block: np.ndarray
    t: Array
    run: np.ndarray

    def residual(self, values: Array) -> Array:
        """(k, 6) known wrench less that of the parameters ``values`` (p,)."""
        return np.asarray(self.known - self.columns @ values)


def rows_of(arm: Arm, runs: Sequence[BaseRun]) -> Rows:
    """All runs, one after the other."""
    parts, first, blocks = [], 0, []
    for run in runs:
        columns = wrench_columns(arm, run.base, (run.q, run.qd, run.qdd), run.thrust)
        parts.append((run.compared(columns), run.compared(hull_wrench(arm, run.base))))
        blocks.append(run.block + first)
        first += int(run.block[-1]) + 1
    number = np.repeat(np.arange(len(runs)), [len(known) for _, known in parts])
    columns, known = (np.concatenate(column) for column in zip(*parts))
    times = np.concatenate([run.t for run in runs])
    return Rows(tuple(nominal_wrench_parameters(arm)), columns, known, np.concatenate(blocks), times, number)


def whitened(rows: Rows, scale: Array) -> tuple[Array, Array]:
    """(6 k, p) columns and (6 k,) known wrench, rows of a degree over its ``scale`` (6,)."""
    columns = rows.columns / scale[:, None]
    return columns.reshape(-1, columns.shape[-1]), (rows.known / scale).reshape(-1)
