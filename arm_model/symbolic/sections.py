"""Filters of second-order sections compiled: the channels of a recording side by side in the lanes of a vector.

A row of a filter waits for the row before, whatever the processor could do meanwhile: channels one after the other take
as many times as long as there are channels. Every operation is rounded as in scipy's ``sosfilt``, in its order.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.symbolic.machine_code import LANES, engine_of, key_of

_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 2, *[ctypes.c_void_p] * 3)


def both_ways(sections: Array, rest: Array, values: Array, pad: int) -> Array:
    """Values (m, n) filtered along the rows, forwards and then back, each time from rest on the first value.

    sections (k, 6), their first denominators 1; rest (k, 2): their states at rest on a constant 1 (``sosfilt_zi``);
    pad: rows by which the ends are continued meanwhile, odd about the first and the last.
    """
    width, count = min(LANES, 1 << (values.shape[1] - 1).bit_length()), len(values)
    run = _compiled(len(sections), width)
    sections, smooth = np.ascontiguousarray(sections, float), np.empty(values.shape[::-1])
    rows = np.zeros((count + 2 * pad, width))
    for first in range(0, values.shape[1], width):
        own = values[:, first : first + width]
        inside = rows[:, : own.shape[1]]
        inside[pad : pad + count] = own
        if pad:
            inside[:pad] = 2 * own[:1] - own[pad:0:-1]
            inside[-pad:] = 2 * own[-1:] - own[-2 : -(pad + 2) : -1]
        for step, start in ((1, 0), (-1, len(rows) - 1)):
            state = rest[..., None] * rows[start]
            at = rows.ctypes.data + start * rows.strides[0]
            run(len(rows), step, sections.ctypes.data, state.ctypes.data, at)
        smooth[first : first + width] = inside[pad : pad + count].T
    return smooth.T


@cache
def _compiled(sections: int, width: int) -> Any:
    """``_module`` as a function; it holds its machine code."""
    text = f"{sections} sections, {width} lanes"
    engine = engine_of(key_of(text, Path(__file__)), lambda: _module(sections, width))
    run = _SIGNATURE(engine.get_function_address("run"))
    run.engine = engine  # type: ignore[attr-defined]
    return run


def _module(count: int, width: int) -> str:
    """run(count, step, sections (count, 6), state (count, 2, width), at (width)): rows from ``at`` on, in place."""
    from llvmlite import ir

    from arm_model.symbolic.codegen import DOUBLE, INT, Vector

    module = ir.Module(name="sections")
    lanes = (ir.VectorType(DOUBLE, width) if width > 1 else DOUBLE).as_pointer()
    signature = ir.FunctionType(ir.VoidType(), [INT, INT, DOUBLE.as_pointer(), lanes, lanes])
    function = ir.Function(module, signature, "run")
    rows, step, sections, state, at = function.args
    before, loop, after = (function.append_basic_block(name) for name in ("before", "loop", "after"))
    build = ir.IRBuilder(before)
    vector = Vector(build, width)
    b0, b1, b2, _, a1, a2 = (
        [vector.spread(build.load(build.gep(sections, [INT(6 * s + place)]))) for s in range(count)]
        for place in range(6)
    )
    start = [build.load(build.gep(state, [INT(place)]), align=8) for place in range(2 * count)]
    build.branch(loop)
    build = ir.IRBuilder(loop)
    number = build.phi(INT)
    kept = [build.phi(one.type) for one in start]
    place = build.gep(at, [build.mul(number, step)])
    x, following = build.load(place, align=8), []
    for s in range(count):
        # no fused operations: each is rounded
        y = build.fadd(build.fmul(b0[s], x), kept[2 * s])
        first = build.fadd(build.fsub(build.fmul(b1[s], x), build.fmul(a1[s], y)), kept[2 * s + 1])
        following += [first, build.fsub(build.fmul(b2[s], x), build.fmul(a2[s], y))]
        x = y
    build.store(x, place, align=8)
    done = build.add(number, INT(1))
    for phi, one, other in zip([number, *kept], [INT(0), *start], [done, *following]):
        phi.add_incoming(one, before)
        phi.add_incoming(other, loop)
    build.cbranch(build.icmp_signed("<", done, rows), loop, after)
    ir.IRBuilder(after).ret_void()
    return str(module)
