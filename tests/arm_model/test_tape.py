"""The tape: folding, differentiation, printing, and compiled functions to the last digits."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from llvmlite import ir

from arm_model.description import Arm
from arm_model.rigid_body import scalar
from arm_model.simulation.simulation import system_of
from arm_model.symbolic.codegen import DOUBLE, Vector, emit
from arm_model.symbolic.printing import c_function, equations, python_function
from arm_model.symbolic.tape import Tape, derivative, evaluate, operations
from arm_model.system.kernel_inputs import numbers


def test_trivial_operations_cost_nothing() -> None:
    tape = Tape()
    x, y = tape.input("x"), tape.input("y")
    zero = tape.constant(0.0)
    negative = -x
    assert operations(tape, [x * 1.0 + 0.0 * y + zero, x - 0.0, -negative, (x + y) - (y + x)]) == 0
    assert (x * y).index == (y * x).index
    assert (x + -y).index == (x - y).index
    assert operations(tape, [x * y + x * y]) == 2
    assert operations(tape, [3.0 * (x + x) * 0.5]) == 1


def test_derivative_is_the_slope() -> None:
    tape = Tape()
    x, y = tape.input("x"), tape.input("y")
    f = (
        scalar.sin(x * y) * scalar.exp(-x) / (2.0 + scalar.cos(x))
        + scalar.log(1.0 + x * x)
        + scalar.sqrt(1.0 + x * x)
        + scalar.smooth_sign(x, 0.3) * y
    )
    point = {"x": 0.7, "y": -0.4}
    step = 1e-6
    (ahead,), (behind,) = (evaluate(tape, [f], point | {"x": 0.7 + s}) for s in (step, -step))
    (slope,) = evaluate(tape, [derivative(f, x)], point)
    assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-8)


@pytest.mark.parametrize("name", ["sin", "cos", "exp", "log", "rsqrt", "sqrt"])
def test_compiled_functions_are_exact_to_a_few_last_places(name: str) -> None:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    tape = Tape()
    x = tape.input("x")
    result = 1.0 / scalar.sqrt(x) if name == "rsqrt" else getattr(scalar, name)(x)
    module = ir.Module()
    function = ir.Function(module, ir.FunctionType(DOUBLE, [DOUBLE]), "f")
    builder = ir.IRBuilder(function.append_basic_block())
    builder.ret(emit(Vector(builder, 1), tape, [result], {x.index: lambda: function.args[0]})[0])
    machine = llvm.Target.from_default_triple().create_target_machine(jit=True)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(str(module)), machine)
    engine.finalize_object()
    compiled = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(engine.get_function_address("f"))
    rng = np.random.default_rng(0)
    wide = (
        rng.uniform(-700, 700, 2000)
        if name == "exp"
        else np.concatenate([rng.normal(size=1000), rng.uniform(-1e5, 1e5, 1000)])
    )
    if name == "log":
        wide = np.concatenate([np.exp(rng.uniform(-300, 300, 1000)), 1.0 + rng.uniform(-0.4, 0.6, 1000), [1.0, 0.5]])
    points = np.abs(wide) + 1e-12 if "sqrt" in name else wide
    exact = {"rsqrt": lambda v: 1 / math.sqrt(v)}.get(name) or getattr(math, name)
    ours, true = np.array([compiled(v) for v in points]), np.array([exact(v) for v in points])
    np.testing.assert_allclose(
        ours, true, rtol=1e-15 if name == "sqrt" else 2e-15, atol=3e-16 if name in ("sin", "cos") else 0
    )


def test_printed_python_and_c_are_the_tape(puma: Arm, tmp_path: Path) -> None:
    system = system_of(puma)
    inputs = {name: float(value[0]) for name, value in numbers(puma).items()}
    rng = np.random.default_rng(1)
    inputs |= {name: float(rng.normal()) for name in system.states} | {
        f"current{j}": float(rng.normal()) for j in range(6)
    }
    expected = np.array(evaluate(system.tape, system.rates, inputs), float)
    used = sorted({node.name for node in system.tape.nodes if node.operation == "input"} & set(inputs))
    names = {name: f"v[{k}]" for k, name in enumerate(used)}
    values = np.array([inputs[name] for name in used])
    space = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt, "exp": math.exp, "minimum": min, "maximum": max}
    exec(python_function("rates", ["v"], system.tape, system.rates, names), space)
    np.testing.assert_allclose(space["rates"](values), expected, rtol=1e-11)  # type: ignore[operator]
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler to try the C source with")
    source = "#include <math.h>\n" + c_function("rates", ["const double *v"], system.tape, system.rates, names)
    (tmp_path / "rates.c").write_text(source)
    subprocess.run(
        [compiler, "-O1", "-shared", "-fPIC", "-o", tmp_path / "rates.so", tmp_path / "rates.c", "-lm"], check=True
    )
    out = np.zeros(len(expected))
    ctypes.CDLL(str(tmp_path / "rates.so")).rates(ctypes.c_void_p(values.ctypes.data), ctypes.c_void_p(out.ctypes.data))
    np.testing.assert_allclose(out, expected, rtol=1e-11)


def test_equations_read_as_written() -> None:
    tape = Tape()
    x, y = tape.input("x"), tape.input("y")
    s = scalar.sin(x)
    assert (
        equations(tape, {"a": s * (x - y), "b": s / (x - (y - 2.0))})
        == "t1 = sin(x)\na = t1 * (x - y)\nb = t1 / (x - (y - 2.0))"
    )
