"""What these cores can do at most, fused multiply-adds on the engine's vectors; and what the engine's code asks for.

``benchmarks.simulation`` reports the share of the one in the other.
"""

from __future__ import annotations

import ctypes
import re
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from llvmlite import ir

from arm_io.parallel import cores
from arm_model.simulation.kernel import module_of
from arm_model.symbolic.codegen import Vector
from arm_model.symbolic.machine_code import lanes, machine_for_engine, target
from arm_model.symbolic.tape import Expr
from arm_model.system.closed_loop_system import System

CHAINS = 12
"""Independent sums: as many as hide the delay of a multiply-add (4 cycles, two units)."""
ROUNDS = 20_000_000
DOUBLE, INT = ir.DoubleType(), ir.IntType(64)
ARITHMETIC = re.compile(r"= (?:fadd|fsub|fmul|fdiv|fneg)\b")


def multiply_adds() -> ir.Module:
    """``run(rounds, out)``: CHAINS sums x = x a + b of one vector each, so often; no memory but the end."""
    module, lane = ir.Module(name="peak"), ir.VectorType(DOUBLE, lanes(64))
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [INT, lane.as_pointer()]), "run")
    builder = ir.IRBuilder(function.append_basic_block("entry"))
    vector = Vector(builder, lanes(64))
    factor, addend = vector.constant(0.999), vector.constant(0.001)
    entry, body, after = builder.block, builder.append_basic_block("body"), builder.append_basic_block("after")
    builder.branch(body)
    builder.position_at_end(body)
    index = builder.phi(INT)
    index.add_incoming(INT(0), entry)
    sums = [builder.phi(lane) for _ in range(CHAINS)]
    for k, total in enumerate(sums):
        total.add_incoming(ir.Constant(lane, [float(k)] * lanes(64)), entry)
        total.add_incoming(vector.fused(total, factor, addend), body)
    following = builder.add(index, INT(1))
    index.add_incoming(following, body)
    builder.cbranch(builder.icmp_signed("<", following, function.args[0]), body, after)
    builder.position_at_end(after)
    for k, total in enumerate(sums):
        builder.store(total.incomings[1][0], builder.gep(function.args[1], [INT(k)]), align=8)
    builder.ret_void()
    return module


def peak_rate() -> float:
    """Floating-point operations per second of all cores at once: the best of three."""
    llvm, machine, _ = target()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine_for_engine())
    code = machine.emit_object(llvm.parse_assembly(str(multiply_adds())))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    run = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p)(engine.get_function_address("run"))
    ends = [np.zeros((CHAINS, lanes(64))) for _ in range(cores())]
    best = np.inf
    with ThreadPoolExecutor(cores()) as pool:
        for _ in range(3):
            began = time.perf_counter()
            list(pool.map(lambda end: run(ROUNDS, end.ctypes.data), ends))
            best = min(best, time.perf_counter() - began)
    return 2 * CHAINS * lanes(64) * ROUNDS * cores() / best


def operations_a_step(system: System, params: tuple[Expr, ...], substeps: int) -> float:
    """Floating-point operations of one Runge-Kutta step of one lane: four times the rates, a share of the servo tick.

    Counted in the code as it is generated: additions, multiplications and divisions, each once (a fused multiply-add is
    two); roots, comparisons and the sums of the Runge-Kutta rule itself are not counted.
    """
    parts = dict.fromkeys(("rates", "servo"), 0)
    text = str(module_of(system, params, lanes(64)))
    for name in parts:
        start = re.search(rf"define[^\n]*@\"?{name}\"?\(", text)
        assert start is not None
        body = text[start.start() : text.index("\n}", start.start())]
        parts[name] = len(ARITHMETIC.findall(body))
    return 4 * parts["rates"] + parts["servo"] / substeps
