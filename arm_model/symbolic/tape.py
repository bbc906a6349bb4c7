"""Expressions as a tape of single operations, each written once however often it is used (hash-consing).

An ``Expr`` behaves like a number: the Newton-Euler recursion, friction laws and effects are run on it once, and what
they computed stands on the tape, to be evaluated with numpy (``evaluate``), compiled (``arm_model.symbolic.codegen``)
or printed. Products by 0 and 1, sums with 0 and constants among themselves fold; operands of + and * are sorted, so
that a b and b a are one operation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Operand = Any
"""An Expr or a real number."""

COMMUTATIVE = frozenset({"add", "mul", "min", "max"})
_NUMERIC: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "min": np.minimum,
    "max": np.maximum,
    "neg": np.negative,
    "sin": np.sin,
    "cos": np.cos,
    "sqrt": np.sqrt,
    "rsqrt": lambda x: 1.0 / np.sqrt(x),
    "exp": np.exp,
    "log": np.log,
    "abs": np.abs,
    "where": lambda a, b, below, otherwise: np.where(np.less(a, b), below, otherwise),
}


@dataclass(frozen=True, slots=True)
class Node:
    """One operation: ``arguments`` are indices of earlier nodes; an input has a ``name``, a constant a ``value``."""

    operation: str
    arguments: tuple[int, ...] = ()
    name: str = ""
    value: float = 0.0


class Tape:
    """Nodes in the order in which they were first needed; arguments always stand before their use."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._index: dict[Node, int] = {}

    def _place(self, node: Node) -> Expr:
        index = self._index.get(node)
        if index is None:
            index = self._index[node] = len(self.nodes)
            self.nodes.append(node)
        return Expr(self, index)

    def constant(self, value: float) -> Expr:
        return self._place(Node("const", value=float(value) + 0.0))

    def input(self, name: str) -> Expr:
        """A quantity given from outside; the same name is the same quantity."""
        return self._place(Node("input", name=name))

    def expr(self, value: Operand) -> Expr:
        return value if isinstance(value, Expr) else self.constant(float(value))

    def unary(self, operation: str, a: Expr) -> Expr:
        if a.value is not None:
            return self.constant(float(_NUMERIC[operation](a.value)))
        node = self.nodes[a.index]
        if operation == "neg":
            if node.operation == "neg":
                return Expr(self, node.arguments[0])
            if node.operation == "sub":
                return self.binary("sub", Expr(self, node.arguments[1]), Expr(self, node.arguments[0]))
        if operation == "sqrt" and node.operation == "mul" and node.arguments[0] == node.arguments[1]:
            return self.unary("abs", Expr(self, node.arguments[0]))
        if operation in ("cos", "abs") and node.operation == "neg":
            a = Expr(self, node.arguments[0])
        return self._place(Node(operation, (a.index,)))

    def binary(self, operation: str, a: Expr, b: Expr) -> Expr:
        if a.value is not None and b.value is not None:
            with np.errstate(all="ignore"):  # a link without mass has no acceleration; whoever asks for it gets nan
                return self.constant(float(_NUMERIC[operation](a.value, b.value)))
        simpler = self._folded(operation, a, b)
        if simpler is not None:
            return simpler
        pair = (a.index, b.index)
        return self._place(Node(operation, tuple(sorted(pair)) if operation in COMMUTATIVE else pair))

    def where(self, a: Operand, b: Operand, below: Operand, otherwise: Operand) -> Expr:
        """``below`` where a < b, else ``otherwise``; both are computed."""
        return self._place(Node("where", tuple(self.expr(one).index for one in (a, b, below, otherwise))))

    def _folded(self, operation: str, a: Expr, b: Expr) -> Expr | None:
        """A simpler expression of the same value, where there is one."""
        if operation in ("add", "mul") and a.value is not None:
            a, b = b, a
        known, minus_a, minus_b = b.value, self._negated(a), self._negated(b)
        match operation:
            case "add" if known == 0.0:
                return a
            case "add" if a.index == b.index:
                return a * 2.0
            case "add" if minus_b is not None:
                return a - minus_b
            case "add" if minus_a is not None:
                return b - minus_a
            case "sub" if a.index == b.index:
                return self.constant(0.0)
            case "sub" if known == 0.0:
                return a
            case "sub" if a.value == 0.0:
                return -b
            case "sub" if minus_b is not None:
                return a + minus_b
            case "sub" if minus_a is not None:
                return -(minus_a + b)
            case "mul" if known == 0.0:
                return self.constant(0.0)
            case "mul" | "div" if known == 1.0:
                return a
            case "mul" | "div" if known == -1.0:
                return -a
            case "mul" if known is not None and (scaled := self._scaled(a)) is not None:
                return scaled[0] * (scaled[1] * known)
            case "mul" | "div" if minus_a is not None:
                return -self.binary(operation, minus_a, b)
            case "mul" | "div" if minus_b is not None:
                return -self.binary(operation, a, minus_b)
            case "div" if a.value == 0.0:
                return self.constant(0.0)
            case "div" if known is not None:
                return a * (1.0 / known)
        return None

    def _scaled(self, a: Expr) -> tuple[Expr, float] | None:
        """(b, number) where a is b times a number."""
        node = self.nodes[a.index]
        if node.operation == "mul":
            first, second = (Expr(self, index) for index in node.arguments)
            if second.value is not None:
                return first, second.value
            if first.value is not None:
                return second, first.value
        return None

    def _negated(self, a: Expr) -> Expr | None:
        """b where a is -b."""
        node = self.nodes[a.index]
        return Expr(self, node.arguments[0]) if node.operation == "neg" else None


class Expr:
    """A value on a tape. Adds, multiplies, and so on, with others of its tape and with numbers."""

    __array_ufunc__ = None  # numpy leaves mixed operations to the methods below
    __slots__ = ("index", "tape")

    def __init__(self, tape: Tape, index: int) -> None:
        self.tape = tape
        self.index = index

    @property
    def value(self) -> float | None:
        """The number, where it is a constant."""
        node = self.tape.nodes[self.index]
        return node.value if node.operation == "const" else None

    def _binary(self, operation: str, other: Operand) -> Expr:
        return self.tape.binary(operation, self, self.tape.expr(other))

    def __add__(self, other: Operand) -> Expr:
        return self._binary("add", other)

    __radd__ = __add__

    def __sub__(self, other: Operand) -> Expr:
        return self._binary("sub", other)

    def __rsub__(self, other: Operand) -> Expr:
        return self.tape.expr(other)._binary("sub", self)

    def __mul__(self, other: Operand) -> Expr:
        return self._binary("mul", other)

    __rmul__ = __mul__

    def __truediv__(self, other: Operand) -> Expr:
        other = self.tape.expr(other)
        node = self.tape.nodes[other.index]
        if node.operation == "sqrt":  # one operation instead of two slow ones
            return self * self.tape.unary("rsqrt", Expr(self.tape, node.arguments[0]))
        return self._binary("div", other)

    def __rtruediv__(self, other: Operand) -> Expr:
        return self.tape.expr(other) / self

    def __pow__(self, power: int) -> Expr:
        if power < 1:
            raise ValueError("only whole powers from 1 are on the tape")
        return math.prod([self] * (power - 1), start=self)

    def __neg__(self) -> Expr:
        return self.tape.unary("neg", self)

    def __abs__(self) -> Expr:
        return self.tape.unary("abs", self)

    def sin(self) -> Expr:
        return self.tape.unary("sin", self)

    def cos(self) -> Expr:
        return self.tape.unary("cos", self)

    def sqrt(self) -> Expr:
        return self.tape.unary("sqrt", self)

    def exp(self) -> Expr:
        return self.tape.unary("exp", self)

    def log(self) -> Expr:
        return self.tape.unary("log", self)

    def minimum(self, other: Operand) -> Expr:
        return self._binary("min", other)

    def maximum(self, other: Operand) -> Expr:
        return self._binary("max", other)


def needed(tape: Tape, outputs: Iterable[Expr], given: Container[int] = ()) -> list[int]:
    """Indices of the nodes that the outputs depend on, in the tape's order; behind ``given`` ones is not looked."""
    wanted: set[int] = set()
    stack = [output.index for output in outputs]
    while stack:
        index = stack.pop()
        if index not in wanted:
            wanted.add(index)
            if index not in given:
                stack.extend(tape.nodes[index].arguments)
    return sorted(wanted)


def evaluate(
    tape: Tape, outputs: Sequence[Expr], inputs: Mapping[str, Operand], order: Sequence[int] | None = None
) -> list[Any]:
    """Values of the outputs by numpy, for inputs that are numbers or arrays of one shape.

    order  ``needed(tape, outputs)``, where it is known already
    """
    values: dict[int, Any] = {}
    with np.errstate(all="ignore"):
        for index in needed(tape, outputs) if order is None else order:
            node = tape.nodes[index]
            if node.operation == "const":
                values[index] = node.value
            elif node.operation == "input":
                values[index] = inputs[node.name]
            else:
                values[index] = _NUMERIC[node.operation](*(values[a] for a in node.arguments))
    return [values[output.index] for output in outputs]


def operations(tape: Tape, outputs: Iterable[Expr]) -> int:
    """How many arithmetic operations the outputs cost."""
    return sum(tape.nodes[index].operation not in ("const", "input") for index in needed(tape, outputs))


def derivative(expression: Expr, by: Expr) -> Expr:
    """d expression / d by, on the same tape, for the smooth operations: + - * / sin cos sqrt 1/sqrt exp log."""
    return rate(expression, [(by, expression.tape.constant(1.0))])


def rate(expression: Expr, moving: Iterable[tuple[Expr, Expr]]) -> Expr:
    """d expression / dt where each first of ``moving`` changes at the rate of the second and nothing else does."""
    tape = expression.tape
    slopes = {value.index: change for value, change in moving}
    given = frozenset(slopes)
    for index in needed(tape, [expression], given=given):
        if index not in given:
            node = tape.nodes[index]
            values = [Expr(tape, a) for a in node.arguments]
            slopes[index] = _slope(Expr(tape, index), node, values, [slopes[a] for a in node.arguments])
    return slopes[expression.index]


def _slope(whole: Expr, node: Node, values: list[Expr], inner: list[Expr]) -> Expr:
    match node.operation:
        case "const" | "input":
            return whole.tape.constant(0.0)
        case "add":
            return inner[0] + inner[1]
        case "sub":
            return inner[0] - inner[1]
        case "mul":
            return inner[0] * values[1] + values[0] * inner[1]
        case "div":
            return (inner[0] - whole * inner[1]) / values[1]
        case "neg":
            return -inner[0]
        case "sin":
            return inner[0] * values[0].cos()
        case "cos":
            return -(inner[0] * values[0].sin())
        case "sqrt":
            return inner[0] / (2.0 * whole)
        case "rsqrt":
            return inner[0] * whole * whole * whole * -0.5
        case "exp":
            return inner[0] * whole
        case "log":
            return inner[0] / values[0]
    raise ValueError(f"{node.operation} has no derivative everywhere")
