"""Functions of a scalar of any kind: floats and arrays (numpy), tape expressions, sympy symbols.

Friction laws, effects and the Newton-Euler recursion are written once with these and +, -, *, /.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Scalar = Any


def _call(name: str, x: Scalar) -> Scalar:
    if isinstance(x, float | int | np.ndarray | np.generic):
        return getattr(np, name)(x)
    if hasattr(x, name):  # an expression of arm_model.symbolic.tape
        return getattr(x, name)()
    import sympy

    return getattr(sympy, name)(x)


def sin(x: Scalar) -> Scalar:
    """Sine of an angle, rad."""
    return _call("sin", x)


def cos(x: Scalar) -> Scalar:
    """Cosine of an angle, rad."""
    return _call("cos", x)


def sqrt(x: Scalar) -> Scalar:
    """Square root."""
    return _call("sqrt", x)


def exp(x: Scalar) -> Scalar:
    """Exponential function."""
    return _call("exp", x)


def log(x: Scalar) -> Scalar:
    """Natural logarithm."""
    return _call("log", x)


def absolute(x: Scalar) -> Scalar:
    """Magnitude."""
    return abs(x)


def minimum(a: Scalar, b: Scalar) -> Scalar:
    """The smaller of two."""
    return _pair("minimum", "Min", a, b)


def maximum(a: Scalar, b: Scalar) -> Scalar:
    """The larger of two."""
    return _pair("maximum", "Max", a, b)


def _pair(name: str, symbolic: str, a: Scalar, b: Scalar) -> Scalar:
    known = (float, int, np.ndarray, np.generic)
    if isinstance(a, known) and isinstance(b, known):
        return getattr(np, name)(a, b)
    for this, other in ((a, b), (b, a)):
        if hasattr(this, name):
            return getattr(this, name)(other)
    import sympy

    return getattr(sympy, symbolic)(a, b)


def smooth_sign(v: Scalar, width: Scalar) -> Scalar:
    """v / sqrt(v^2 + width^2): the sign of v, smooth over +-width."""
    return v / sqrt(v * v + width * width)
