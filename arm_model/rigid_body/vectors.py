"""Vectors of three scalars of any kind.

Floats, (N,) arrays of N samples, expressions of ``arm_model.symbolic.tape``, sympy symbols.

Products by the float 0 vanish, which keeps the generated equations short and numpy from multiplying zeros.
"""

from __future__ import annotations

from collections.abc import Sequence

from arm_io.types import Array
from arm_model.rigid_body.scalar import Scalar

Triple = tuple[Scalar, Scalar, Scalar]


def mul(a: Scalar, b: Scalar) -> Scalar:
    """a b."""
    for this, other in ((a, b), (b, a)):
        if isinstance(this, float):
            if this == 0.0:
                return 0.0
            if this == 1.0:
                return other
            if this == -1.0:
                return -other
    return a * b


def add(a: Scalar, b: Scalar) -> Scalar:
    """a + b."""
    if isinstance(a, float) and a == 0.0:
        return b
    return a if isinstance(b, float) and b == 0.0 else a + b


def sub(a: Scalar, b: Scalar) -> Scalar:
    """a - b."""
    if isinstance(a, float) and a == 0.0:
        return -b
    return a if isinstance(b, float) and b == 0.0 else a - b


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    """a . b."""
    return add(add(mul(a[0], b[0]), mul(a[1], b[1])), mul(a[2], b[2]))


def cross(a: Triple, b: Triple) -> Triple:
    """a x b."""
    return (
        sub(mul(a[1], b[2]), mul(a[2], b[1])),
        sub(mul(a[2], b[0]), mul(a[0], b[2])),
        sub(mul(a[0], b[1]), mul(a[1], b[0])),
    )


def plus(a: Triple, b: Triple) -> Triple:
    """a + b, entry by entry."""
    return add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2])


def floats(values: Array) -> tuple[float, ...]:
    """The entries as plain floats, or as the expressions that they are."""
    return tuple(values.tolist())


def apply(matrix: Sequence[Triple], v: Triple) -> Triple:
    """matrix v, the matrix by its three rows."""
    return dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v)
