"""The vehicle that carries a simulated arm: what its own computer asks of the thrusters beside keeping station."""

from __future__ import annotations

from typing import Annotated
from zlib import crc32

import numpy as np
from pydantic import Field

from arm_io.table import Rate, Seconds, Table
from arm_io.types import Array
from arm_model.motion import BaseTrack

POSE, VELOCITY = 7, 6
"""Columns of a row of the base: position and attitude (w, x, y, z); velocity. The thrusters' demands follow."""


class ThrusterTable(Table):
    """``[simulation.thrusters]``: sums of sines, added to each thruster's demand while the arm's motion lasts.

    amplitude  N, of the sines of one thruster together; 0: the vehicle only keeps station
    waves      sines per thruster, of frequencies drawn between ``lowest`` and ``highest`` Hz
    fade       s in which they grow at the beginning
    """

    amplitude: Annotated[float, Field(ge=0)] = 0.0
    waves: Annotated[int, Field(ge=1, le=100)] = 4
    lowest: Rate = 0.02
    highest: Rate = 0.3
    fade: Seconds = 5.0


class ThrusterSines:
    """``ThrusterTable`` as a function of time, for ``thrusters`` of them.

    The same for the same seed and the same name of an experiment: recordings to fit and to hold out differ.
    """

    def __init__(self, table: ThrusterTable, thrusters: int, seed: int, experiment: str) -> None:
        rng = np.random.default_rng([seed, crc32(experiment.encode())])
        shape = (thrusters, table.waves)
        self._spin = 2 * np.pi * rng.uniform(min(table.lowest, table.highest), table.highest, shape)
        self._phase = rng.uniform(0, 2 * np.pi, shape)
        self._size, self._fade = table.amplitude / np.sqrt(table.waves), table.fade

    def __call__(self, t: Array, end: float) -> Array:
        """(k, thrusters) N at times (k,) s since the beginning; nothing from ``end`` s on."""
        waves = np.sin(t[:, None, None] * self._spin + self._phase).sum(axis=2)
        share = np.where(t < end, np.clip(t / self._fade, 0.0, 1.0), 0.0)
        return np.asarray(self._size * share[:, None] * waves)


def rows_of(base: BaseTrack) -> Array:
    """(R, 13 + thrusters) position, attitude, velocity and demands of one simulation."""
    return np.concatenate([base.position, base.attitude, base.velocity, base.demand], axis=-1)


def moored(row: Array) -> Array:
    """A row (13 + thrusters,) held where it is: without velocity and demands."""
    return np.where(np.arange(len(row)) < POSE, row, 0.0)


def at_home(thrusters: int) -> Array:
    """(13 + thrusters,) in the world's origin, upright."""
    row = np.zeros(POSE + VELOCITY + thrusters)
    row[3] = 1.0
    return row
