"""The rows that compiled code fills, as the motion of an arm."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model.motion import BaseTrack, Motion
from arm_model.simulation.lanes import Lanes
from arm_model.symbolic.tape import evaluate
from arm_model.system.closed_loop_system import System
from arm_model.system.floating_base import POSE, VELOCITY


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
