"""An arm standing still, held by its motors: where a simulation starts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.symbolic.tape import evaluate, needed
from arm_model.system.closed_loop_system import System
from arm_model.system.floating_base import POSE, VELOCITY

SETTLED = 1e-13
"""rad: links that move less from one substitution to the next hang where they are."""


def standing(
    system: System, inputs: Mapping[str, Array], theta: Array, base: Array | None = None
) -> tuple[dict[str, Array], Array]:
    """States (name -> (lanes,)) and currents (lanes, n) A at rest with the motors at ``theta`` (lanes, n) rad.

    ``base`` (13,): position, attitude and velocity of a floating base; absent: at rest in the world's origin.

    Links behind a two-mass transmission hang where its torque carries them: found by repeated substitution, which
    converges while the spring is stiffer than gravity. Bristles are unloaded.
    """
    lanes, n = theta.shape
    states = {name: np.zeros(lanes) for name in system.states}
    for j in range(n):
        states[f"theta{j}"] = theta[:, j].copy()
    for j in system.flexible:
        states[f"phi{j}"] = theta[:, j].copy()
    if system.held:
        placed = (0.0,) * 3 + (1.0,) + (0.0,) * 9 if base is None else base
        states |= {name: np.full(lanes, float(value)) for name, value in zip((*POSE, *VELOCITY), placed)}
    still = {f"current{j}": np.zeros(lanes) for j in range(system.channels)} | {"time": np.zeros(lanes)}
    asked = [*system.carried, *system.drag]
    order = needed(system.tape, asked)
    for _ in range(50 if system.flexible else 1):
        torques = evaluate(system.tape, asked, {**inputs, **states, **still}, order)
        carried, drag = torques[:n], torques[n:]
        moved = 0.0
        for j in system.flexible:
            twist = _twist(system, j, {**inputs, **still}, np.broadcast_to(carried[j], (lanes,)))
            moved = max(moved, float(np.max(np.abs(theta[:, j] - twist - states[f"phi{j}"]))))
            states[f"phi{j}"] = theta[:, j] - twist
        if moved < SETTLED:
            break
    current = np.zeros((lanes, n))
    for j in range(n):
        current[:, j] = (carried[j] + drag[j]) / inputs[f"drive{j}"]
    return states, current


def base_memories(
    system: System, inputs: Mapping[str, Array], states: Mapping[str, Array], theta: Array
) -> dict[str, Array]:
    """(lanes,) memories of a station keeping that has held the base where it is: its pose, and the wrench for this.

    What the feed-forward gives at rest is not in the integrators.
    """
    n, lanes = system.joints, len(theta)
    asked = {f"{name}{j}": theta[:, j] for name in ("demand", "last_demand", "earlier_demand") for j in range(n)}
    still = {f"current{j}": np.zeros(lanes) for j in range(system.channels)} | {"time": np.zeros(lanes)}
    everything = {**inputs, **states, **asked, **still}
    held = [np.broadcast_to(value, (lanes,)) for value in evaluate(system.tape, system.held, everything)]
    ahead = evaluate(system.tape, system.feedforward, everything) or [0.0] * len(held)
    found = {f"base_integral{k}": held[k] - ahead[k] for k in range(len(held))}
    found |= {f"station{k}": states[name] for k, name in enumerate(POSE)}
    return found | {f"earlier_demand{j}": theta[:, j] for j in range(n)}


def start_memories(arm: Arm, theta: Array, current: Array) -> dict[str, Array]:
    """Memories of servos that have been at rest at ``theta`` (lanes, n) rad, with ``current`` (lanes, n) A flowing.

    ``theta`` is also their demand.

    The integrators hold the current; where there are none they hold it all the same, as an offset that was there
    before.
    """
    found: dict[str, Array] = {}
    if arm.controller is None:
        return found
    for j in range(len(arm)):
        found[f"integral{j}"] = current[:, j]
        found[f"last{j}"] = found[f"last_demand{j}"] = theta[:, j]
        found[f"filtered{j}"] = np.zeros(len(theta))
    return found


def _twist(system: System, j: int, inputs: Mapping[str, Array], torque: Array) -> Array:
    """Twist (rad) at which joint j's transmission transmits ``torque`` (lanes,) at rest.

    Without load the joint is in the middle of its backlash.
    """
    states = {name: np.zeros_like(torque) for name in system.states}
    order = needed(system.tape, [system.passed[j]])
    # the torque is the same all through the play: both of its edges
    low, high = np.full((2, *torque.shape), -1.0), np.full((2, *torque.shape), 1.0)
    for _ in range(60):
        middle = (low + high) / 2
        (given,) = evaluate(system.tape, [system.passed[j]], {**inputs, **states, f"theta{j}": middle}, order)
        upper, lower = np.broadcast_to(np.asarray(given, float), middle.shape)
        beyond = np.stack([upper > torque, lower >= torque])
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    edges = (low + high) / 2
    return np.asarray((edges[0] + edges[1]) / 2)
