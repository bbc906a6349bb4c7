"""Rows of the wrench on a floating base, filtered alike on both sides.

Columns and signs: ``arm_model.moving_base.regressor``; one-sided and dead thrusters: ``thrust``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from arm_model.moving_base import floating, hull_wrench, nominal_wrench_parameters, wrench_columns
from arm_model.tables import OF_THRUSTER, base_parameters
from identification.floating_base.rows import BaseRun
from identification.floating_base.thrust import ThrustTable, thrust_table

FAULTS = tuple(name for name in OF_THRUSTER if name != "gain")
"""Parameters of a thruster beside its gain."""


@dataclass(frozen=True)
class Rows:
    """Compared rows of runs, one after the other: k rows of the six degrees of freedom.

    names       (p,) of the parameters; columns (k, 6, p): wrench per unit of each at the model's values, N and N m
    known       (k, 6): wrench that the rigid vehicle takes
    block       (k,) number of the block of each row, from 0
    t           (k,) s; run (k,) number of its run
    allocation  (6, thrusters) wrench per N of each thruster
    demand      (k, thrusters) N, behind the time constants of the thrusters
    table       of the thrusters; None: their gains are the only parameters they have
    """

    names: tuple[str, ...]
    columns: Array
    known: Array
    block: np.ndarray
    t: Array
    run: np.ndarray
    allocation: Array
    demand: Array
    table: ThrustTable | None = None

    def residual(self, values: Array) -> Array:
        """(k, 6) known wrench less that of the parameters ``values`` (p,)."""
        if self.table is None:
            return np.asarray(self.known - self.columns @ values)
        others = [k for k, name in enumerate(self.names) if not name.startswith("thruster")]
        return np.asarray(self.known - self.columns[:, :, others] @ values[others] - self.thrust_wrench(values))

    def thrust_wrench(self, values: Array) -> Array:
        """(k, 6) wrench of all thrusters."""
        if self.table is not None:
            return np.asarray(self.thrusts(values) @ self.allocation.T)
        of_thrusters = [k for k, name in enumerate(self.names) if name.startswith("thruster")]
        return np.asarray(self.columns[:, :, of_thrusters] @ values[of_thrusters])

    def thrusts(self, values: Array) -> Array:
        """(k, thrusters) N of each thruster."""
        if self.table is not None:
            by_thruster = [self.table.thrust(k, self._of_thruster(k, values)) for k in range(self.allocation.shape[1])]
            return np.stack(by_thruster, axis=1) if by_thruster else np.zeros((len(self.t), 0))
        of_thrusters = [k for k, name in enumerate(self.names) if name.startswith("thruster")]
        lengths = (self.allocation**2).sum(axis=0)
        return np.asarray(
            np.einsum("kim,im->km", self.columns[:, :, of_thrusters], self.allocation) / lengths * values[of_thrusters]
        )

    def slopes(self, values: Array, free: Sequence[int]) -> Array:
        """(k, 6, f) wrench per unit of the parameters ``free`` (numbers of columns) at ``values``."""
        found = self.columns[:, :, list(free)]
        thrusters = {_thruster_of(self.names[k]) for k in free if self.names[k].startswith("thruster")}
        if self.table is None or not thrusters:
            return found
        place = {self.names[k]: at for at, k in enumerate(free)}
        for k in thrusters:
            for name, slope in self.table.slopes(k, self._of_thruster(k, values)).items():
                if (whole := f"thruster{k + 1}.{name}") in place:
                    found[:, :, place[whole]] = slope
        return found

    def largest(self, name: str) -> float:
        """N: largest dead zone of a thruster, by the parameter's name, that a fit tries."""
        return 0.0 if self.table is None else self.table.largest(_thruster_of(name))

    def part(self, taken: NDArray[np.bool_]) -> Rows:
        """Some of the rows (mask (k,)), with their blocks numbered anew."""
        block = np.unique(self.block[taken], return_inverse=True)[1]
        return replace(
            self,
            columns=self.columns[taken],
            known=self.known[taken],
            block=block,
            t=self.t[taken],
            run=self.run[taken],
            demand=self.demand[taken],
            table=None if self.table is None else self.table.of(taken),
        )

    def _of_thruster(self, k: int, values: Array) -> Mapping[str, float]:
        return {name: float(values[self.names.index(f"thruster{k + 1}.{name}")]) for name in OF_THRUSTER}


def _thruster_of(name: str) -> int:
    """Number from 0 of the thruster whose parameter this is."""
    return int(name.partition(".")[0].removeprefix("thruster")) - 1


def rows_of(arm: Arm, runs: Sequence[BaseRun], *, faults: bool = False) -> Rows:
    """All runs, one after the other; ``faults``: with ``FAULTS`` of every thruster behind the other parameters."""
    parts, first, blocks = [], 0, []
    for run in runs:
        columns = wrench_columns(arm, run.base, (run.q, run.qd, run.qdd), run.thrust)
        parts.append((run.compared(columns), run.compared(hull_wrench(arm, run.base))))
        blocks.append(run.block + first)
        first += int(run.block[-1]) + 1
    number = np.repeat(np.arange(len(runs)), [len(known) for _, known in parts])
    columns, known = (np.concatenate(column) for column in zip(*parts))
    times = np.concatenate([run.t for run in runs])
    demand = np.concatenate([run.compared(run.thrust_of(run.demand)) for run in runs])
    names, table = tuple(nominal_wrench_parameters(arm)), None
    if faults and arm.thrusters:
        more = tuple(f"thruster{k + 1}.{name}" for k in range(arm.thrusters) for name in FAULTS)
        names, table = (*names, *more), thrust_table(floating(arm), list(runs))
        columns = np.concatenate([columns, np.zeros((*columns.shape[:2], len(more)))], axis=2)
    rows = Rows(names, columns, known, np.concatenate(blocks), times, number, floating(arm).allocation, demand, table)
    return rows if table is None else replace(rows, columns=rows.slopes(nominal_values(arm, rows), range(len(names))))


def nominal_values(arm: Arm, rows: Rows) -> Array:
    """(p,) parameters of the rows as the model has them."""
    stated = base_parameters(floating(arm)) | nominal_wrench_parameters(arm)
    return np.array([stated[name] for name in rows.names])


def whitened(rows: Rows, values: Array, scale: Array, free: Sequence[int]) -> tuple[Array, Array]:
    """(6 k, f) slopes of ``free`` at ``values`` and (6 k,) residual there, rows of a degree over its ``scale`` (6,)."""
    slopes = rows.slopes(values, free) / scale[:, None]
    return slopes.reshape(-1, slopes.shape[-1]), (rows.residual(values) / scale).reshape(-1)
