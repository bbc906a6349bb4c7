"""Thrust of every thruster over its dead zone: what a one-sided or dead thruster changes in the wrench.

Per unit of gain, thruster k gives forward * ahead(d) + reverse * astern(d): the parts of its demand beyond the dead
zone d (``arm_model.moving_base.beyond``), behind its time constant and through the filters of the compared rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model.moving_base import beyond
from arm_model.tables import FloatingBase
from identification.floating_base.rows import BaseRun

ZONES = 16
"""Dead zones at which thrust is filtered; between them it is a straight line."""
LARGEST = 0.6
"""Largest of them, as a share of the largest demand: what it leaves no longer moves a vehicle."""


@dataclass(frozen=True)
class ThrustTable:
    """Of m thrusters: allocation (6, m), zone (m, ZONES) N, ahead and astern (k, m, ZONES) N at the compared rows."""

    allocation: Array
    zone: Array
    ahead: Array
    astern: Array

    def of(self, rows: NDArray[np.bool_]) -> ThrustTable:
        """Some of the rows (mask (k,))."""
        return ThrustTable(self.allocation, self.zone, self.ahead[rows], self.astern[rows])

    def largest(self, k: int) -> float:
        """N: largest dead zone of thruster k (from 0) that the table has."""
        return float(self.zone[k, -1])

    def thrust(self, k: int, values: Mapping[str, float]) -> Array:
        """(rows,) N of thruster k (from 0) at the ``values`` of all its parameters."""
        ahead, astern = self._parts(k, values["dead_zone"])[:2]
        return np.asarray(values["gain"] * (values["forward"] * ahead + values["reverse"] * astern))

    def slopes(self, k: int, values: Mapping[str, float]) -> dict[str, Array]:
        """(rows, 6) wrench per unit of each parameter of thruster k (from 0) at ``values``."""
        ahead, astern, less_ahead, less_astern = self._parts(k, values["dead_zone"])
        gain, forward, reverse = values["gain"], values["forward"], values["reverse"]
        slopes = {
            "gain": forward * ahead + reverse * astern,
            "forward": gain * ahead,
            "reverse": gain * astern,
            "dead_zone": gain * (forward * less_ahead + reverse * less_astern),
        }
        return {name: np.outer(slope, self.allocation[:, k]) for name, slope in slopes.items()}

    def _parts(self, k: int, zone: float) -> tuple[Array, Array, Array, Array]:
        """(rows,) each: the parts of the demand of thruster k beyond a dead zone, and their slopes over it."""
        grid = self.zone[k]
        at = int(np.clip(np.searchsorted(grid, zone, side="right") - 1, 0, len(grid) - 2))
        step = max(float(grid[at + 1] - grid[at]), 1e-12)
        forces, slopes = [], []
        for part in (self.ahead[:, k], self.astern[:, k]):
            slope = (part[:, at + 1] - part[:, at]) / step
            forces.append(part[:, at] + slope * (zone - grid[at]))
            slopes.append(slope)
        return forces[0], forces[1], slopes[0], slopes[1]


def zones_of(base: FloatingBase, runs: list[BaseRun]) -> Array:
    """(m, ZONES) N: from 0, for each thruster as far as its demands in the runs reach."""
    top = np.max([np.abs(run.demand).max(axis=0, initial=0.0) for run in runs], axis=0)
    stated = np.array([2 * thruster.dead_zone for thruster in base.thruster])
    return np.outer(np.maximum(np.maximum(LARGEST * top, stated), 1e-6), np.linspace(0.0, 1.0, ZONES))


def thrust_table(base: FloatingBase, runs: list[BaseRun]) -> ThrustTable:
    """The table of runs, one after the other."""
    zone = zones_of(base, runs)
    parts: list[tuple[list[Array], list[Array]]] = [([], []) for _ in range(ZONES)]
    for run in runs:
        for number in range(ZONES):
            for side, demand in zip(parts[number], beyond(run.demand, zone[:, number])):
                side.append(run.compared(run.thrust_of(demand)))
    ahead, astern = (np.stack([np.concatenate(of[side]) for of in parts], axis=-1) for side in (0, 1))
    return ThrustTable(base.allocation, zone, ahead, astern)
