"""Simulations of an arm under its servos: one, or many at once (lanes = parameter sets).

``stepper`` simulates block by block, for the simulated rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from arm_io import InputError, counted
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import check_terms
from arm_model.geometry import relinked
from arm_model.motion import Motion
from arm_model.simulation.advance import advance_in_parts
from arm_model.simulation.lanes import prepared
from arm_model.simulation.motion_rows import motion_of_rows
from arm_model.simulation.programs import zeros
from arm_model.simulation.servo_references import Demand, references, row_times, servo_period
from arm_model.system.closed_loop_system import System, build
from arm_model.system.kernel_inputs import numbers
from arm_model.system.step_size import joint_without_inertia

BEYOND = 1e9
"""rad (m), their rates, or A: a simulation with larger values has diverged. Torques up to there fit a model file."""


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
    rows = advance_in_parts(run, given, times)
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
    start: Array | None = None,
    substeps: int | None = None,
) -> Motion:
    """One simulation of ``duration`` s with rows at ``rate`` per second; see ``simulate_at``."""
    return simulate_at(arm, demand, row_times(duration, rate), start=start, substeps=substeps)


def simulate_at(
    arm: Arm, demand: Demand, times: Array, *, start: Array | None = None, substeps: int | None = None
) -> Motion:
    """One simulation with rows at ``times`` (R,) s; see ``simulate_batch``.

    InputError where it diverges (a batch gives NaN).
    """
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
