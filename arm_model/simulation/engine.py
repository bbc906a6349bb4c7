"""Compiles generated systems and runs them on all cores; machine code is kept (``arm_model.symbolic.machine_code``)."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_io.parallel import cores
from arm_io.types import Array
from arm_model.simulation.kernel_layout import layout_of
from arm_model.symbolic.machine_code import engine_of, key_of
from arm_model.symbolic.tape import Expr, needed
from arm_model.system.closed_loop_system import System

_POINTER = ctypes.c_void_p
_SIGNATURE = ctypes.CFUNCTYPE(
    None, ctypes.c_int64, ctypes.c_int64, *[_POINTER] * 6, ctypes.c_int64, ctypes.c_int64, *[_POINTER] * 3
)


@dataclass(frozen=True)
class Program:
    """Compiled code of one system: ``run`` releases the interpreter lock while it runs."""

    system: System
    params: tuple[Expr, ...]
    width: int
    run: Any
    engine: Any  # owns the machine code
    single: bool = False

    @property
    def dtype(self) -> type[np.floating[Any]]:
        """Of the numbers of all lanes."""
        return np.float32 if self.single else np.float64


def _key(system: System, params: tuple[Expr, ...], width: int, single: bool) -> str:
    tape = system.tape
    roots = (*system.rates, *system.next_memories, *system.commands)
    text = [
        f"{width} {single}",
        repr([(index, tape.nodes[index]) for index in needed(tape, roots)]),
        repr([[expr.index for expr in part] for part in (system.rates, system.next_memories, system.commands, params)]),
        repr((system.states, system.memories)),
    ]
    return key_of("\0".join(text), Path(__file__).with_name("kernel.py"))


def program_of(system: System, width: int, *, single: bool) -> Program:
    """The compiled code of a system, from the cache folder, or generated and compiled now."""
    params = layout_of(system)
    key = _key(system, params, width, single)

    def module() -> str:
        from arm_model.simulation.kernel import module_of
        from arm_model.symbolic.codegen import DOUBLES, SINGLES

        return str(module_of(system, params, width, SINGLES if single else DOUBLES))

    engine = engine_of(key, module)
    return Program(system, params, width, _SIGNATURE(engine.get_function_address("run")), engine, single)


def aligned(*shape: int, dtype: type[np.floating[Any]] = np.float64) -> Array:
    """(*shape,) zeros on a 64-byte boundary."""
    size, each = int(np.prod(shape)), np.dtype(dtype).itemsize
    raw = np.zeros(size + 64 // each, dtype)
    offset = (-raw.ctypes.data % 64) // each
    return raw[offset : offset + size].reshape(shape)


@dataclass(frozen=True)
class Schedule:
    """When a block steps, and when its rows are taken: tables of ``arm_model.simulation.kernel``.

    timing: step s, decay of the currents in half a step, time s at the start, ticks, substeps of a tick. substeps,
    weights: of every row (R,), and one that never comes; (R, 5).
    """

    timing: Array
    substeps: NDArray[np.int64]
    weights: Array


def run_blocks(
    program: Program,
    schedules: Sequence[Schedule],
    params: Array,
    states: Array,
    memories: Array,
    currents: Array,
    demands: Array,
    out: Array,
) -> None:
    """Runs all blocks on all cores, each by its schedule.

    Blocks are the leading axis; demands with one block are shared.

    states, memories and currents are advanced in place; out (blocks, rows, states + joints, width) is filled.
    """
    blocks, count = states.shape[0], out.shape[1]
    stride = 0 if demands.shape[0] == 1 else demands[0].size // program.width
    pointers = [array.ctypes.data for array in (params, states, memories, currents, demands)]

    def part(first: int, last: int) -> None:
        schedule = schedules[first]
        rows = schedule.substeps.ctypes.data, schedule.weights.ctypes.data, out.ctypes.data
        program.run(first, last, schedule.timing.ctypes.data, *pointers, stride, count, *rows)

    pieces = min(blocks, 4 * cores()) if cores() > 1 else 1
    edges = {*np.linspace(0, blocks, pieces + 1).astype(int).tolist()}
    edges |= {k for k in range(1, blocks) if schedules[k] is not schedules[k - 1]}
    parts = list(itertools.pairwise(sorted(edges)))
    if cores() == 1 or len(parts) == 1:
        for first, last in parts:
            part(first, last)
        return
    # those that take longest first; threads that end here: beside those of a pool that stays, ``arm_io.parallel``
    # could not fork any more
    parts.sort(key=lambda one: -schedules[one[0]].timing[-1] * (one[1] - one[0]))
    with ThreadPoolExecutor(cores(), thread_name_prefix="arm") as pool:
        list(pool.map(part, *zip(*parts)))
