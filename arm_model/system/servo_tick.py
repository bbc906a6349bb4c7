"""The servos of the joints as expressions: what a tick makes of memories and demands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_model.description import Arm
from arm_model.rigid_body import scalar
from arm_model.symbolic.tape import Expr
from arm_model.system import floating_base
from arm_model.system.links import Symbols
from arm_model.system.mechanics import Mechanics


@dataclass(frozen=True)
class ServoTick:
    """One tick: the next value of each memory, and the commands, in terms of memories and demands."""

    memories: tuple[str, ...]
    next_memories: tuple[Expr, ...]
    commands: tuple[Expr, ...]

    def followed_by(self, base: floating_base.Tick) -> ServoTick:
        """The servos of the joints, then the controller of the base."""
        return ServoTick(
            (*self.memories, *base.memories),
            (*self.next_memories, *base.next_memories),
            (*self.commands, *base.commands),
        )


def servo_tick(arm: Arm, symbol: Symbols, mechanics: Mechanics, theta: list[Expr]) -> ServoTick:
    """One tick of the independent-joint servos (``arm_model.tables.controller``); input demand{j} rad.

    If the arm has no controller, the demands are the currents of the drives, A.
    """
    tape, controller = symbol.tape, arm.controller
    if controller is None:
        return ServoTick((), (), tuple(tape.input(f"demand{j}") for j in range(len(arm))))
    period = controller.servo_period
    share = 1.0 if controller.velocity_bandwidth is None else 1.0 - np.exp(-controller.velocity_bandwidth * period)
    memories, following, commands = [], [], []
    for j in range(len(arm)):
        demand = tape.input(f"demand{j}")
        integral, last = tape.input(f"integral{j}"), tape.input(f"last{j}")
        filtered, last_demand = tape.input(f"filtered{j}"), tape.input(f"last_demand{j}")
        error = demand - theta[j]
        integral = integral + symbol(f"ki{j}") * period * error
        velocity = filtered + share * ((theta[j] - last) / period - filtered)
        ahead = controller.velocity_reference * (demand - last_demand) / period
        current = symbol(f"kp{j}") * error + integral + symbol(f"kd{j}") * (ahead - velocity)
        for bound in mechanics.current_bounds(j):
            current = scalar.maximum(-bound, scalar.minimum(bound, current))
        commands.append(current)
        memories += [f"integral{j}", f"last{j}", f"filtered{j}", f"last_demand{j}"]
        following += [integral, theta[j], velocity, demand]
    return ServoTick(tuple(memories), tuple(following), tuple(commands))
