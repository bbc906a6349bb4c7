"""Linear models of one input and one output, x' = A x + b u, y = C x, and how they move between two ticks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm

from arm_io import InputError
from arm_io.types import Array


@dataclass(frozen=True)
class LinearModel:
    """State equations: ``a`` (n, n) 1/s, ``b`` (n,), ``c`` (n,). Raises InputError if shapes or stability are wrong."""

    a: Array
    b: Array
    c: Array

    def __post_init__(self) -> None:
        n = len(self.b)
        if self.a.shape != (n, n) or self.c.shape != (n,):
            raise InputError(
                "linear model", f"has A {self.a.shape}, b {self.b.shape}, C {self.c.shape}; expected n x n, n, n"
            )
        if not (np.linalg.eigvals(self.a).real < 0).all():
            raise InputError("linear model", "is not asymptotically stable; expected poles left of the imaginary axis")

    @cached_property
    def relative_degree(self) -> int:
        """Smallest d with C A^(d-1) b not zero: the derivative of the output in which the input appears first."""
        for d in range(1, len(self.b) + 1):
            if self.markov(d - 1) != 0.0:
                return d
        raise InputError("linear model", "passes nothing from its input to its output")

    @cached_property
    def rows(self) -> Array:
        """(n + 1, n) C, C A, ..., C A^n: the output's derivatives by the state, without input."""
        return np.array([self.c @ np.linalg.matrix_power(self.a, power) for power in range(len(self.b) + 1)])

    def markov(self, power: int) -> float:
        """C A^power b; 0 where it is below the rounding of its terms."""
        terms = self.rows[power] * self.b
        value = float(terms.sum())
        return value if abs(value) > 1e-12 * float(np.abs(terms).sum()) else 0.0

    def sampled(self, period: float) -> tuple[Array, Array]:
        """(A_d (n, n), b_d (n,)) of x(t + period) = A_d x + b_d u for an input held over the period (s), exact."""
        n = len(self.b)
        block = np.zeros((n + 1, n + 1))
        block[:n, :n], block[:n, n] = self.a, self.b
        moved = expm(block * period)
        return moved[:n, :n], moved[:n, n]


def second_order(a0: float, a1: float) -> LinearModel:
    """a0 / (s^2 + a1 s + a0): unit gain, relative degree 2; a0 in rad2/s2, a1 in rad/s."""
    return LinearModel(np.array([[0.0, 1.0], [-a0, -a1]]), np.array([0.0, a0]), np.array([1.0, 0.0]))
