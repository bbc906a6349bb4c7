"""What of a generated system is the same throughout a run, and therefore computed once per lane, before it."""

from __future__ import annotations

from arm_model.symbolic.tape import Expr
from arm_model.system.closed_loop_system import System


def layout_of(system: System) -> tuple[Expr, ...]:
    """The largest expressions that depend on parameters only, in the order in which the compiled code takes them."""
    tape = system.tape
    changing = {*system.states, *system.memories, "time"}
    changing |= {f"{name}{j}" for name in ("current", "demand") for j in range(system.channels)}
    moving: list[bool] = []
    for node in tape.nodes:
        is_input = node.operation == "input"
        moving.append(node.name in changing if is_input else any(moving[a] for a in node.arguments))
    wanted: set[int] = set()
    seen: set[int] = set()
    stack = [expr.index for expr in (*system.rates, *system.next_memories, *system.commands)]
    while stack:
        index = stack.pop()
        if index in seen:
            continue
        seen.add(index)
        if moving[index]:
            stack.extend(tape.nodes[index].arguments)
        elif tape.nodes[index].operation != "const":
            wanted.add(index)
    return tuple(Expr(tape, index) for index in sorted(wanted))
