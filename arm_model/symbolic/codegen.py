"""Tape expressions as LLVM vector code: every value is a vector of ``width`` lanes, one lane per parameter set.

sin, cos, exp and log are branch-free: range reduction by a magic addition (Cody and Waite, Software Manual for the
Elementary Functions, 1980) and the polynomials of Cephes / fdlibm, right to about 1 unit in the last place for
arguments up to 1e5. In single precision the same polynomials, with the constants of single precision (Cephes) for the
reduction: right to 1e-7 for arguments up to 1e3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from llvmlite import ir

from arm_model.symbolic.tape import Expr, Tape, needed

DOUBLE, FLOAT, INT = ir.DoubleType(), ir.FloatType(), ir.IntType(64)
FUSE = ("contract",)
"""a b + c may become one fused operation."""

_SINE = (
    -1.66666666666666307295e-1,
    8.33333333332211858878e-3,
    -1.98412698295895385996e-4,
    2.75573136213857245213e-6,
    -2.50507477628578072866e-8,
    1.58962301576546568060e-10,
)
_COSINE = (
    4.16666666666665929218e-2,
    -1.38888888888730564116e-3,
    2.48015872888517045348e-5,
    -2.75573141792967388112e-7,
    2.08757008419747316778e-9,
    -1.13585365213876817300e-11,
)
_LOGARITHM = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)


@dataclass(frozen=True)
class Precision:
    """A floating-point format.

    name    of LLVM's intrinsics; bits of a number, fraction of its bits, bias of its exponent
    half_pi, log2   in parts that multiply by small integers exactly
    largest         argument of exp
    half            bits of sqrt(1/2), from which the mantissa of a logarithm is taken
    guess, steps    of the inverse square root: magic number (Lomont 2003), Newton steps
    """

    name: str
    real: ir.Type
    bits: int
    fraction: int
    bias: int
    half_pi: tuple[float, ...]
    log2: tuple[float, ...]
    largest: float
    half: int
    guess: int
    steps: int

    @property
    def magic(self) -> float:
        """Adding it leaves the rounded integer in the low bits."""
        return 1.5 * 2.0**self.fraction


DOUBLES = Precision(
    name="f64",
    real=DOUBLE,
    bits=64,
    fraction=52,
    bias=1023,
    half_pi=(1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
    log2=(6.93147180369123816490e-1, 1.90821492927058770002e-10),
    largest=708.0,
    half=0x3FE6A09E667F3BCD,
    guess=0x5FE6EB50C7B537A9,
    steps=4,
)
SINGLES = Precision(
    name="f32",
    real=FLOAT,
    bits=32,
    fraction=23,
    bias=127,
    half_pi=(1.5703125, 4.837512969970703125e-4, 7.54978995489188216e-8),
    log2=(0.693359375, -2.12194440e-4),
    largest=87.0,
    half=0x3F3504F3,
    guess=0x5F375A86,
    steps=3,
)


class Vector:
    """Builds operations on vectors of ``width`` numbers of one precision in one basic block.

    fused: a b + c may be rounded once.
    """

    def __init__(
        self, builder: ir.IRBuilder, width: int, precision: Precision = DOUBLES, *, fused: bool = True
    ) -> None:
        self.builder, self.width, self.precision = builder, width, precision
        self.flags = FUSE if fused else ()
        whole = ir.IntType(precision.bits)
        self.type = ir.VectorType(precision.real, width) if width > 1 else precision.real
        self.int_type = ir.VectorType(whole, width) if width > 1 else whole

    def constant(self, value: float) -> Any:
        return ir.Constant(self.type, [value] * self.width if self.width > 1 else value)

    def integer(self, value: int) -> Any:
        return ir.Constant(self.int_type, [value] * self.width if self.width > 1 else value)

    def spread(self, scalar: Any) -> Any:
        """One double in every lane."""
        if self.precision.bits < 64:
            scalar = self.builder.fptrunc(scalar, self.precision.real)
        if self.width == 1:
            return scalar
        whole = self.builder.insert_element(
            ir.Constant(self.type, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
        )
        mask = ir.Constant(ir.VectorType(ir.IntType(32), self.width), [0] * self.width)
        return self.builder.shuffle_vector(whole, ir.Constant(self.type, ir.Undefined), mask)

    def add(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a, b, flags=self.flags)

    def sub(self, a: Any, b: Any) -> Any:
        return self.builder.fsub(a, b, flags=self.flags)

    def mul(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b, flags=self.flags)

    def fused(self, a: Any, b: Any, c: Any) -> Any:
        """a b + c."""
        return self.add(self.mul(a, b), c)

    def intrinsic(self, name: str, a: Any) -> Any:
        """``name`` lane by lane; llvmlite's declare_intrinsic knows no vectors."""
        lanes = "" if self.width == 1 else f"v{self.width}"
        full = f"{name}.{lanes}{self.precision.name}"
        module = self.builder.module
        function = module.globals.get(full) or ir.Function(module, ir.FunctionType(self.type, [self.type]), full)
        return self.builder.call(function, [a])

    def polynomial(self, x: Any, coefficients: Sequence[float]) -> Any:
        """Sum of coefficients[k] x^k by Horner's rule."""
        value = self.constant(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            value = self.fused(value, x, self.constant(coefficient))
        return value

    def _rounded(self, x: Any, scale: float) -> tuple[Any, Any]:
        """round(scale x) as a number and, in the low bits, as an integer."""
        magic = self.constant(self.precision.magic)
        shifted = self.fused(x, self.constant(scale), magic)
        return self.builder.fsub(shifted, magic), self.builder.bitcast(shifted, self.int_type)

    def sine_cosine(self, x: Any) -> tuple[Any, Any]:
        build = self.builder
        turns, bits = self._rounded(x, 2 / math.pi)
        r = x
        for part in self.precision.half_pi:
            r = self.fused(turns, self.constant(-part), r)
        square = self.mul(r, r)
        sine = self.fused(self.mul(square, r), self.polynomial(square, _SINE), r)
        tail = self.mul(self.mul(square, square), self.polynomial(square, _COSINE))
        cosine = self.add(self.fused(square, self.constant(-0.5), self.constant(1.0)), tail)
        odd = build.icmp_signed("!=", build.and_(bits, self.integer(1)), self.integer(0))
        to_sign = self.integer(self.precision.bits - 2)
        sign_of_sine = build.shl(build.and_(bits, self.integer(2)), to_sign)
        sign_of_cosine = build.shl(build.and_(build.add(bits, self.integer(1)), self.integer(2)), to_sign)
        return (
            self._signed(build.select(odd, cosine, sine), sign_of_sine),
            self._signed(build.select(odd, sine, cosine), sign_of_cosine),
        )

    def _signed(self, x: Any, sign: Any) -> Any:
        flipped = self.builder.xor(self.builder.bitcast(x, self.int_type), sign)
        return self.builder.bitcast(flipped, self.type)

    def exp(self, x: Any) -> Any:
        build = self.builder
        largest = self.precision.largest
        x = self.least(self.greatest(x, self.constant(-largest)), self.constant(largest))
        power, bits = self._rounded(x, 1 / math.log(2))
        r = x
        for part in self.precision.log2:
            r = self.fused(power, self.constant(-part), r)
        mantissa = self.polynomial(r, [1 / math.factorial(k) for k in range(14)])
        exponent = build.shl(build.add(bits, self.integer(self.precision.bias)), self.integer(self.precision.fraction))
        return self.mul(mantissa, build.bitcast(exponent, self.type))

    def log(self, x: Any) -> Any:
        """Natural logarithm of x, normal and positive: x = 2^k (1 + f), sqrt(1/2) <= 1 + f < sqrt(2)."""
        build, one = self.builder, self.precision
        bits = build.bitcast(x, self.int_type)
        power = build.ashr(build.sub(bits, self.integer(one.half)), self.integer(one.fraction))
        f = self.sub(
            build.bitcast(build.sub(bits, build.shl(power, self.integer(one.fraction))), self.type), self.constant(1.0)
        )
        magic = self.constant(one.magic)
        k = build.fsub(build.bitcast(build.add(power, build.bitcast(magic, self.int_type)), self.type), magic)
        s = build.fdiv(f, self.add(f, self.constant(2.0)))
        square, half = self.mul(s, s), self.mul(self.mul(f, f), self.constant(0.5))
        tail = self.mul(s, self.add(half, self.mul(square, self.polynomial(square, _LOGARITHM))))
        high, low = (self.mul(k, self.constant(part)) for part in one.log2)
        return build.fsub(high, build.fsub(build.fsub(half, build.fadd(tail, low)), f))

    def rsqrt(self, x: Any) -> Any:
        """1 / sqrt(x), x normal and positive, to 1e-15 relative (1e-7 in single precision), without a slow division.

        A first guess is taken from the exponent and refined by Newton steps.
        """
        build = self.builder
        half_bits = build.lshr(build.bitcast(x, self.int_type), self.integer(1))
        guess = build.bitcast(build.sub(self.integer(self.precision.guess), half_bits), self.type)
        half = self.mul(x, self.constant(-0.5))
        for _ in range(self.precision.steps):
            guess = self.mul(guess, self.fused(self.mul(half, guess), guess, self.constant(1.5)))
        return guess

    def least(self, a: Any, b: Any) -> Any:
        return self.builder.select(self.builder.fcmp_ordered("<", a, b), a, b)

    def greatest(self, a: Any, b: Any) -> Any:
        return self.builder.select(self.builder.fcmp_ordered(">", a, b), a, b)

    def where(self, a: Any, b: Any, below: Any, otherwise: Any) -> Any:
        return self.builder.select(self.builder.fcmp_ordered("<", a, b), below, otherwise)


def emit(vector: Vector, tape: Tape, outputs: Sequence[Expr], given: Mapping[int, Callable[[], Any]]) -> list[Any]:
    """Code for the outputs, after what stands in the block already.

    ``given``: node index -> function that makes its value (a load); every input that is needed must be among them.
    """
    values: dict[int, Any] = {}
    pairs: dict[int, tuple[Any, Any]] = {}
    build = vector.builder
    operations: dict[str, Callable[..., Any]] = {
        "add": vector.add,
        "sub": vector.sub,
        "mul": vector.mul,
        "div": lambda a, b: build.fdiv(a, b),
        "min": vector.least,
        "max": vector.greatest,
        "where": vector.where,
    }
    unary: dict[str, Callable[[Any], Any]] = {
        "neg": lambda a: build.fneg(a),
        "sqrt": lambda a: vector.intrinsic("llvm.sqrt", a),
        "rsqrt": vector.rsqrt,
        "exp": vector.exp,
        "log": vector.log,
        "abs": lambda a: vector.intrinsic("llvm.fabs", a),
    }
    for index in needed(tape, outputs, given):
        if index in given:
            values[index] = given[index]()
            continue
        node = tape.nodes[index]
        arguments = [values[a] for a in node.arguments]
        match node.operation:
            case "const":
                values[index] = vector.constant(node.value)
            case "sin" | "cos":
                angle = node.arguments[0]
                if angle not in pairs:
                    pairs[angle] = vector.sine_cosine(arguments[0])
                values[index] = pairs[angle][node.operation == "cos"]
            case operation if operation in operations:
                values[index] = operations[operation](*arguments)
            case operation:
                values[index] = unary[operation](*arguments)
    return [values[output.index] for output in outputs]
