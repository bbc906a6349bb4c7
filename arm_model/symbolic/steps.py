"""Expressions compiled for rows of which each continues the one before: loops that numpy cannot do at once.

Several series are computed side by side: what one of them waits for, the processor does meanwhile for the others.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.symbolic.machine_code import engine_of, key_of
from arm_model.symbolic.tape import Expr, Tape, needed

_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 3, *[ctypes.c_void_p] * 4)


@dataclass(frozen=True)
class Steps:
    """Compiled steps of a number of ``series``; ``run`` releases the interpreter lock while it runs."""

    series: int
    run: Any
    engine: Any  # owns the machine code

    def __call__(self, numbers: Array, start: Array, *columns: Array, backwards: bool = False) -> Array:
        """(series, N) outputs for the numbers of all rows, the states (series, s) before the first, and columns.

        columns (series, N) each. backwards: from the last row to the first, before which the states are given.
        """
        shared, states = np.ascontiguousarray(numbers, float), np.ascontiguousarray(start, float)
        rows = [np.ascontiguousarray(one, float) for one in columns]
        count, out = rows[0].shape[1], np.empty((self.series, rows[0].shape[1]))
        inside = np.array([one[k].ctypes.data for one in rows for k in range(self.series)])
        into = np.array([one.ctypes.data for one in out])
        if count:
            addresses = (one.ctypes.data for one in (shared, states, inside, into))
            self.run(count, count - 1 if backwards else 0, -1 if backwards else 1, *addresses)
        return out


def steps_of(
    tape: Tape,
    output: Expr,
    following: Mapping[str, Expr],
    *,
    columns: Sequence[str],
    numbers: Sequence[str],
    series: int = 1,
) -> Steps:
    """The output of every row as a function of the tape's inputs: its own ``columns``, ``numbers``, and the states.

    following  the states, in their order, and what each is for the next row
    Operations are rounded one by one, as numpy rounds them.
    """
    outputs, states = [output, *following.values()], list(following)
    nodes = [(index, tape.nodes[index]) for index in needed(tape, outputs)]
    text = repr((nodes, [one.index for one in outputs], states, tuple(columns), tuple(numbers), series))
    key = key_of(text, Path(__file__))
    engine = engine_of(key, lambda: _module(tape, outputs, states, columns, numbers, series))
    return Steps(series, _SIGNATURE(engine.get_function_address("run")), engine)


def _module(
    tape: Tape,
    outputs: Sequence[Expr],
    states: Sequence[str],
    columns: Sequence[str],
    numbers: Sequence[str],
    series: int,
) -> str:
    """run(rows, first, stride, numbers, states (series, s), inside [columns][series], out [series]); a row or more.

    inside, out: addresses of (N,) each.
    """
    from llvmlite import ir

    from arm_model.symbolic.codegen import DOUBLE, INT, Vector, emit

    module, doubles = ir.Module(name="steps"), DOUBLE.as_pointer()
    types = [INT, INT, INT, doubles, doubles, doubles.as_pointer(), doubles.as_pointer()]
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), types), "run")
    count, first, stride, shared, start, inside, out = function.args
    before, loop, after = (function.append_basic_block(name) for name in ("before", "loop", "after"))
    once, build = ir.IRBuilder(before), ir.IRBuilder(loop)

    def known(array: Any, place: int) -> Any:
        return once.load(once.gep(array, [INT(place)]))

    done, row = build.phi(INT), build.phi(INT)
    state = [[build.phi(DOUBLE) for _ in states] for _ in range(series)]
    for_all = {tape.input(name).index: known(shared, place) for place, name in enumerate(numbers)}
    results = []
    for k in range(series):
        of_series = {
            tape.input(name).index: build.load(build.gep(known(inside, place * series + k), [row]))
            for place, name in enumerate(columns)
        }
        of_series |= {tape.input(name).index: value for name, value in zip(states, state[k])}
        given = {index: lambda value=value: value for index, value in (for_all | of_series).items()}
        results.append(emit(Vector(build, 1, fused=False), tape, outputs, given))
    for k, (result, *_) in enumerate(results):
        build.store(result, build.gep(known(out, k), [row]))
    following = build.add(done, INT(1)), build.add(row, stride)
    for counter, initial, after_row in zip((done, row), (INT(0), first), following):
        counter.add_incoming(initial, before)
        counter.add_incoming(after_row, loop)
    for k, (_, *after_row) in enumerate(results):
        for place, (value, new) in enumerate(zip(state[k], after_row)):
            value.add_incoming(known(start, k * len(states) + place), before)
            value.add_incoming(new, loop)
    once.branch(loop)
    build.cbranch(build.icmp_signed("<", following[0], count), loop, after)
    ir.IRBuilder(after).ret_void()
    return str(module)
