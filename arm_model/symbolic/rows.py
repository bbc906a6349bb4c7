"""Expressions compiled for recordings: each row alike, ``LANES`` rows at a time."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.symbolic.machine_code import LANES, engine_of, key_of
from arm_model.symbolic.tape import Expr, Tape, needed

_SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_int64, *[ctypes.c_void_p] * 3)


@dataclass(frozen=True)
class Rows:
    """Compiled expressions of ``columns`` values per row; ``run`` releases the interpreter lock while it runs."""

    columns: int
    outputs: int
    run: Any
    engine: Any  # owns the machine code

    def __call__(self, numbers: Array, *rows: Array) -> Array:
        """(N, outputs) for the numbers that all rows share, and rows (N, ...) with all columns side by side."""
        count, groups = len(rows[0]), -(-len(rows[0]) // LANES)
        inside, full, first = np.ones((groups, self.columns, LANES)), count // LANES, 0
        for part in rows:
            columns = inside[:, first : first + part.shape[1]]
            columns[:full] = part[: full * LANES].reshape(full, LANES, part.shape[1]).transpose(0, 2, 1)
            columns[full:, :, : count - full * LANES] = part[full * LANES :].T
            first += part.shape[1]
        out = np.empty((groups, self.outputs, LANES))
        shared = np.ascontiguousarray(numbers, float)
        self.run(groups, shared.ctypes.data, inside.ctypes.data, out.ctypes.data)
        return out.transpose(0, 2, 1).reshape(-1, self.outputs)[:count]


def rows_of(tape: Tape, outputs: Sequence[Expr], columns: Sequence[str], numbers: Sequence[str]) -> Rows:
    """The outputs as a function of the tape's inputs: ``columns``, a value per row, and ``numbers``, one for all."""
    nodes = [(index, tape.nodes[index]) for index in needed(tape, outputs)]
    text = repr((nodes, [one.index for one in outputs], tuple(columns), tuple(numbers)))
    engine = engine_of(key_of(text, Path(__file__)), lambda: _module(tape, outputs, columns, numbers))
    return Rows(len(columns), len(outputs), _SIGNATURE(engine.get_function_address("run")), engine)


def _module(tape: Tape, outputs: Sequence[Expr], columns: Sequence[str], numbers: Sequence[str]) -> str:
    """run(groups, numbers, rows (groups, columns, LANES), out (groups, outputs, LANES))."""
    from llvmlite import ir

    from arm_model.symbolic.codegen import DOUBLE, INT, Vector, emit

    module = ir.Module(name="rows")
    lanes = ir.VectorType(DOUBLE, LANES).as_pointer()
    signature = ir.FunctionType(ir.VoidType(), [INT, DOUBLE.as_pointer(), lanes, lanes])
    function = ir.Function(module, signature, "run")
    groups, shared, rows, out = function.args
    for pointer in (shared, rows, out):
        pointer.add_attribute("noalias")
    before, loop, after = (function.append_basic_block(name) for name in ("before", "loop", "after"))
    ir.IRBuilder(before).branch(loop)
    build = ir.IRBuilder(loop)
    group = build.phi(INT)
    group.add_incoming(INT(0), before)
    vector = Vector(build, LANES)
    first_in, first_out = (
        build.gep(base, [build.mul(group, INT(n))]) for base, n in ((rows, len(columns)), (out, len(outputs)))
    )
    given = {
        tape.input(name).index: lambda place=place: build.load(build.gep(first_in, [INT(place)]), align=8)
        for place, name in enumerate(columns)
    } | {
        tape.input(name).index: lambda place=place: vector.spread(build.load(build.gep(shared, [INT(place)])))
        for place, name in enumerate(numbers)
    }
    for place, value in enumerate(emit(vector, tape, outputs, given)):
        build.store(value, build.gep(first_out, [INT(place)]), align=8)
    following = build.add(group, INT(1))
    group.add_incoming(following, loop)
    build.cbranch(build.icmp_signed("<", following, groups), loop, after)
    ir.IRBuilder(after).ret_void()
    return str(module)
