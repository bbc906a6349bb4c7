"""Simulations of an arm under its servos: one, or many at once (lanes = parameter sets).

``stepper`` simulates block by block, for the simulated rig.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError, counted
from arm_io.progress import report
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import check_terms
from arm_model.geometry import relinked
from arm_model.motion import BaseTrack, Motion
from arm_model.simulation.engine import Program, Schedule, aligned, run_blocks
from arm_model.simulation.programs import program_for, zeros
from arm_model.simulation.servo_references import Demand, references, row_times, servo_period
from arm_model.symbolic.tape import evaluate
from arm_model.system.closed_loop_system import System, build
from arm_model.system.floating_base import POSE, VELOCITY
from arm_model.system.friction_rate import MOST, PRODUCT, friction_rates, softened
from arm_model.system.initial_state import base_memories, standing, start_memories
from arm_model.system.kernel_inputs import numbers
from arm_model.system.step_size import fastest, joint_without_inertia

BASE = len(POSE) + len(VELOCITY)
"""States of a floating base: position (3), attitude (4), velocity (6)."""

BEYOND = 1e9
"""rad (m), their rates, or A: a simulation with larger values has diverged. Torques up to there fit a model file."""
PART = 200_000
"""Ticks that are run between two reports of how far a simulation is."""


@dataclass
class Lanes:
    """Lanes in the middle of a simulation: everything blocked as (blocks, ..., width).

    substeps: Runge-Kutta steps per servo tick (``period`` s) of each block.
    """

    arm: Arm
    program: Program
    inputs: dict[str, Array]
    params: Array
    states: Array
    memories: Array
    currents: Array
    period: float
    substeps: tuple[int, ...]
    lanes: int
    tick: int = 0


def prepared(
    arm: Arm, variations: Mapping[str, Array] | None, start: Array, substeps: int | None, *, single: bool = False
) -> Lanes:
    """Lanes standing still at ``start`` ((n,) or (lanes, n) rad of the motors), held by their motors.

    (n + 13,) rad, m, m/s: a floating base begins with the position, attitude and velocity that come last.
    """
    start, base = np.asarray(start, dtype=np.float64), None
    if arm.floating is not None and start.shape == (len(arm) + BASE,):
        start, base = start[: len(arm)], start[len(arm) :]
    check_terms(arm)
    arm = relinked(arm)
    inputs = numbers(arm, variations)
    lanes = len(inputs["gravity0"])
    start = np.array(np.broadcast_to(start, (lanes, len(arm))), dtype=np.float64)
    program = program_for(arm, inputs, lanes, single=single)
    system, width = program.system, program.width
    states, current = standing(system, inputs, start, base)
    memories = start_memories(arm, start, current)
    if system.held:
        memories |= base_memories(system, inputs, states, start)
    period = servo_period(arm)
    blocks = -(-lanes // width)
    order = np.minimum(np.arange(blocks * width), lanes - 1)
    if substeps is None:
        inputs = softened(arm, inputs, period)
    each = needed_substeps(arm, inputs, period) if substeps is None else np.full(lanes, substeps)

    def blocked(columns: list[Array]) -> Array:
        """(lanes,) each -> (blocks, columns, width); spare lanes repeat the last."""
        room = aligned(blocks, max(len(columns), 1), width, dtype=program.dtype)
        for k, column in enumerate(columns):
            room[:, k] = np.broadcast_to(column, (lanes,))[order].reshape(blocks, width)
        return room

    params = evaluate(system.tape, program.params, inputs)
    flowing = [current[:, j] for j in range(len(arm))] + [np.zeros(lanes)] * system.thrusters
    return Lanes(
        arm=arm,
        program=program,
        inputs=inputs,
        params=blocked([np.asarray(value, float) for value in params]),
        states=blocked([states[name] for name in system.states]),
        memories=blocked([memories[name] for name in system.memories]),
        currents=blocked([*flowing, *flowing]),
        period=period,
        substeps=tuple(each[order].reshape(blocks, width).max(axis=1).tolist()),
        lanes=lanes,
    )


def needed_substeps(arm: Arm, inputs: Mapping[str, Array], period: float) -> NDArray[np.intp]:
    """(lanes,) Runge-Kutta steps per servo tick: as many as the fastest spring, bristle or friction at rest asks for.

    A spring k between inertias a and b with damper c swings at sqrt(k (1/a + 1/b)) and decays at c (1/a + 1/b); the
    step keeps both products with it below 0.4 and 1. A bristle of stiffness s on friction F relaxes at s v / F at speed
    v: below 1. Friction at rest: ``arm_model.system.friction_rate``.
    """
    friction = np.minimum(period * friction_rates(arm, inputs).max(axis=1) / PRODUCT, MOST + 1.0)
    return np.maximum(1, np.ceil(np.maximum(period * fastest(arm, inputs), friction) - 1e-9)).astype(np.intp)


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


def _advance_in_parts(run: Lanes, demands: Array, times: Array) -> Array:
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


def motion_of_rows(run: Lanes, rows: Array, times: Array, demand: Array) -> Motion:
    """The motion, leading axis the lanes, in rows (lanes, R, states + currents) that the engine filled at times (R,) s.

    demand (R, n) rad (m), as it was given.
    """
    system, n = run.program.system, len(run.arm)
    lanes = {name: value[:, None] for name, value in run.inputs.items()}
    states = {name: rows[..., k] for k, name in enumerate(system.states)}
    qm, qmd = rows[..., :n], rows[..., n : 2 * n]
    if _links_follow(system):
        q, qd = qm, qmd
    else:
        values = evaluate(system.tape, [*system.q, *system.qd], {**lanes, **states})
        q, qd = np.stack(values[:n], axis=-1), np.stack(values[n:], axis=-1)
    current = rows[..., len(system.states) : len(system.states) + n]
    drive = np.stack([run.inputs[f"drive{j}"] for j in range(n)], axis=-1)[:, None]
    return Motion(
        t=times,
        q=q,
        qd=qd,
        qm=qm,
        qmd=qmd,
        current=current,
        torque=current * drive,
        demand=demand,
        base=_base_track(system, rows) if system.held else None,
    )


def _links_follow(system: System) -> bool:
    """Whether the links move as the motors do: then angles and speeds of both are the first states."""
    moving = [*system.q, *system.qd]
    return [one.index for one in moving] == [system.tape.input(name).index for name in system.states[: len(moving)]]


def _base_track(system: System, rows: Array) -> BaseTrack:
    place = system.states.index(POSE[0])
    poses = rows[..., place : place + len(POSE)]
    velocity = rows[..., place + len(POSE) : place + len(POSE) + len(VELOCITY)]
    return BaseTrack(poses[..., :3], poses[..., 3:], velocity, rows[..., len(system.states) + system.joints :])


def simulate_batch(
    arm: Arm,
    demand: Demand,
    times: Array,
    *,
    parameters: Mapping[str, Array] | None = None,
    start: Array | None = None,
    substeps: int | None = None,
    single: bool = False,
) -> Motion:
    """One simulation per lane, all of the same demand.

    ``parameters`` maps names (``arm_model.parameters``) to (lanes,) values.

    times (R,) s of the rows, increasing, from 0 on; the arm starts at rest at ``start`` (n,) or (lanes, n) rad, by
    default demand(0), held by its motors. ``substeps``: Runge-Kutta steps per servo tick; default: as many as the
    fastest part of each block of lanes needs (lanes that are alike belong side by side). Returns a Motion with a
    leading axis of lanes. A ``start`` (n + 13,) goes on with the position, attitude and velocity of a floating base,
    which else begins at rest in the world's origin. ``single``: in single precision, twice as fast; positions stay
    within 1e-5 rad (m) of those in double precision. InputError: a demand of another number of joints.
    """
    times = np.asarray(times, float)
    period = servo_period(arm)
    ticks = int(np.floor((times[-1] if len(times) else 0.0) / period + 1e-9)) + 1
    given = references(arm, demand, 0, ticks)
    if given.shape not in ((ticks, len(arm)), (ticks, len(arm) + arm.thrusters)):
        raise InputError(
            "demand", f"gives {given.shape[-1]} positions at a time, the arm has {counted(len(arm), 'joint')}"
        )
    if start is None:
        start = np.zeros(len(arm)) if arm.controller is None else given[0, : len(arm)]
    run = prepared(arm, parameters, start, substeps, single=single)
    rows = _advance_in_parts(run, given, times)
    # a lane that diverged overflows; its callers look for that
    if rows.size and not (rows.max() < BEYOND and rows.min() > -BEYOND):
        rows = np.where(np.abs(rows) < BEYOND, rows, np.nan)
    grid = np.arange(ticks) * period
    shown = np.column_stack([np.interp(times, grid, given[:, j]) for j in range(len(arm))])
    return motion_of_rows(run, rows, times, shown)


def simulate(
    arm: Arm,
    demand: Demand,
    *,
    duration: float,
    rate: float,
    times: Array | None = None,
    start: Array | None = None,
    substeps: int | None = None,
) -> Motion:
    """One simulation of ``duration`` s with rows at ``rate`` per second, or at ``times`` (R,) s.

    See ``simulate_batch``.

    InputError where it diverges (a batch gives NaN).
    """
    times = row_times(duration, rate) if times is None else times
    motion = simulate_batch(arm, demand, times, start=start, substeps=substeps)
    there = np.isfinite(motion.q[0]).all(axis=-1)
    if not there.all():
        began = motion.t[int(np.argmin(there))]
        idle = joint_without_inertia(arm, motion.q[0, 0])
        if idle is not None:
            raise InputError(arm.name, f"joint {idle} moves no inertia of its own; give its drive a rotor_inertia")
        raise InputError(
            arm.name, f"its simulation left all bounds before t = {began:.4g} s; are servo and effects possible?"
        )
    return single(motion)


def single(motion: Motion) -> Motion:
    """The first lane of a batch."""
    names = ("q", "qd", "qm", "qmd", "current", "torque")
    base = None if motion.base is None else motion.base.lane(0)
    return replace(motion, base=base, **{name: getattr(motion, name)[0] for name in names})


def system_of(arm: Arm, variations: Mapping[str, Array] | None = None) -> System:
    """The equations of an arm (and of its ``variations``) as they are compiled, for printing and counting."""
    check_terms(arm)
    arm = relinked(arm)
    return build(arm, zeros(numbers(arm, variations)))
