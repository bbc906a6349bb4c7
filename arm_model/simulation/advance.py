"""Lanes run on by some ticks of their servos; what they show at given times."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.progress import report
from arm_io.types import Array
from arm_model.simulation.engine import Schedule, aligned, run_blocks
from arm_model.simulation.lanes import Lanes

PART = 200_000
"""Ticks that are run between two reports of how far a simulation is."""


def advance(run: Lanes, demands: Array, times: Array) -> Array:
    """Runs len(demands) ticks; ``times`` (R,) s from the start, within them.

    Returns (lanes, R, X + n): states, then currents.

    ``demands`` (ticks, n) for all lanes or (lanes, ticks, n).
    """
    program, system = run.program, run.program.system
    width, n = program.width, system.channels
    ticks = demands.shape[-2]
    if demands.shape[-1] < n:  # nothing is added to what the base's controller asks of its thrusters
        demands = np.concatenate([demands, np.zeros((*demands.shape[:-1], n - demands.shape[-1]))], axis=-1)
    if demands.ndim == 2:
        blocked = aligned(1, ticks, n, width, dtype=program.dtype)
        blocked[:] = demands[None, :, :, None]
    else:
        blocks = run.states.shape[0]
        blocked = aligned(blocks, ticks, n, width, dtype=program.dtype)
        order = np.minimum(np.arange(blocks * width), run.lanes - 1)
        blocked[:] = np.moveaxis(demands[order].reshape(blocks, width, ticks, n), 1, -1)
    lag = 0.0 if run.arm.controller is None else run.arm.controller.current_lag
    out = aligned(run.states.shape[0], len(times), len(system.states) + n, width, dtype=program.dtype)
    schedules = {}
    for substeps in set(run.substeps):
        step = run.period / substeps
        half_decay = math.exp(-step / 2 / lag) if lag > 0 else 0.0
        timing = np.array([step, half_decay, run.tick * run.period, ticks, substeps], float)
        schedules[substeps] = Schedule(timing, *_row_table(times, run.tick, ticks, run.period, substeps, lag))
    of_blocks = [schedules[substeps] for substeps in run.substeps]
    run_blocks(program, of_blocks, run.params, run.states, run.memories, run.currents, blocked, out)
    run.tick += ticks
    lanes_first = np.moveaxis(out, -1, 1)
    if run.lanes < width:  # spare lanes are not copied
        lanes_first = lanes_first[:, : run.lanes]
    flat = lanes_first.reshape(lanes_first.shape[0] * lanes_first.shape[1], *out.shape[1:3])
    return np.asarray(flat[: run.lanes], float)


def advance_in_parts(run: Lanes, demands: Array, times: Array) -> Array:
    """``advance``, which says in between how far it is; all rows are the same."""
    ticks = len(demands)
    if ticks <= PART:
        return advance(run, demands, times)
    tick_of_row = np.floor(times / run.period + 1e-9)
    rows: list[Array] = []
    for first in range(0, ticks, PART):
        report("simulating", first, ticks)
        low, high = np.searchsorted(tick_of_row, (first, first + PART))
        rows.append(advance(run, demands[first : first + PART], times[low:high]))
    return np.concatenate(rows, axis=1)


def _row_table(
    times: Array, tick: int, ticks: int, period: float, substeps: int, lag: float
) -> tuple[NDArray[np.int64], Array]:
    """Substep of every output row (and one that never comes), and its weights: see ``arm_model.simulation.kernel``."""
    step = period / substeps
    place = times / step - tick * substeps
    substep = np.floor(place + 1e-9).astype(np.int64)
    if len(times) and (substep[0] < 0 or substep[-1] >= ticks * substeps or (np.diff(substep) < 0).any()):
        raise InputError("times", "must increase, and lie within the ticks that are run")
    u = np.maximum(place - substep, 0.0)
    u = np.where(u < 1e-9, 0.0, u)
    decay = np.exp(-u * step / lag) if lag > 0 else np.where(u > 0, 0.0, 1.0) * 0.0
    weights = np.stack(
        [
            (1 + 2 * u) * (1 - u) ** 2,
            step * u * (1 - u) ** 2,
            u**2 * (3 - 2 * u),
            step * u**2 * (u - 1),
            decay,
        ],
        axis=1,
    )
    return np.append(substep, -1), np.ascontiguousarray(weights)
