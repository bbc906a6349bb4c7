"""Simulations that run side by side (lanes = parameter sets), blocked as the compiled code takes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import check_terms
from arm_model.geometry import relinked
from arm_model.simulation.engine import Program, aligned
from arm_model.simulation.programs import program_for
from arm_model.simulation.servo_references import servo_period
from arm_model.symbolic.tape import evaluate
from arm_model.system.floating_base import POSE, VELOCITY
from arm_model.system.friction_rate import MOST, PRODUCT, friction_rates, softened
from arm_model.system.initial_state import base_memories, standing, start_memories
from arm_model.system.kernel_inputs import numbers
from arm_model.system.step_size import fastest

BASE = len(POSE) + len(VELOCITY)
"""States of a floating base: position (3), attitude (4), velocity (6)."""


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
