"""A small nonlinear model x' = f(x) + g(x) u, y = h(x), given as text; its Lie derivatives, generated and compiled.

It stands in for a plant that is far more complicated (``arm_model.control.decoupling``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.symbolic.printing import python_function
from arm_model.symbolic.reading import read_formula
from arm_model.symbolic.tape import Expr, Tape, derivative, evaluate, rate

INPUT = "u"
_MATHS = {name: getattr(math, name) for name in ("sin", "cos", "sqrt", "exp")} | {
    "abs": abs,
    "minimum": min,
    "maximum": max,
}


@dataclass(frozen=True)
class Compensator:
    """``rates``: state -> its rate, a formula in the states and u; ``output``: a formula in the states.

    An example, x'' = -4 x' - x'^3 + 0.02 u with output x: ``Compensator({"x": "v", "v": "-4*v - v^3 + 0.02*u"}, "x")``.
    Raises InputError for formulas that cannot be read, are not affine in u, or in which u never reaches the output;
    and where the model, linearised at x = 0, has a zero in the right half-plane (it must be minimum phase).
    """

    rates: Mapping[str, str]
    output: str

    def __post_init__(self) -> None:
        if INPUT in self.rates or not all(name.isidentifier() for name in self.rates):
            raise InputError("compensator", "has a state without a proper name; u is the input")
        _ = self._derivatives
        self._check_minimum_phase()

    @property
    def relative_degree(self) -> int:
        """The derivative of the output in which u appears first."""
        return len(self._derivatives[1]) - 1

    @cached_property
    def lie(self) -> Callable[..., tuple[float, ...]]:
        """x1, x2, ... -> (h, L_f h, ..., L_f^d h, L_g L_f^(d-1) h); straight-line code on plain numbers."""
        tape, outputs = self._derivatives[0], [*self._derivatives[1], self._derivatives[2]]
        return self._compiled("lie", [*self.rates], tape, outputs)

    @cached_property
    def slope(self) -> Callable[..., tuple[float, ...]]:
        """x1, x2, ..., u -> (x1', x2', ...)."""
        tape, _, changes = self._system
        return self._compiled("slope", [*self.rates, INPUT], tape, [change for _, change in changes])

    def advance(self, x: Array, u: float, period: float) -> Array:
        """(n,) state after ``period`` s with u held; one step of Runge and Kutta of order 4."""
        k1 = np.array(self.slope(*x, u))
        k2 = np.array(self.slope(*(x + period / 2 * k1), u))
        k3 = np.array(self.slope(*(x + period / 2 * k2), u))
        k4 = np.array(self.slope(*(x + period * k3), u))
        return np.asarray(x + period / 6 * (k1 + 2 * k2 + 2 * k3 + k4))

    @cached_property
    def _system(self) -> tuple[Tape, dict[str, Expr], list[tuple[Expr, Expr]]]:
        """Tape, its inputs by name, and (state, its rate) of each."""
        tape = Tape()
        names = {name: tape.input(name) for name in (*self.rates, INPUT)}
        return tape, names, [(names[name], read_formula(text, tape, names)) for name, text in self.rates.items()]

    @cached_property
    def _derivatives(self) -> tuple[Tape, list[Expr], Expr]:
        """(tape, [h, L_f h, ..., L_f^d h], L_g L_f^(d-1) h)."""
        tape, names, changes = self._system
        u, zero = names[INPUT], tape.constant(0.0)
        gains = [derivative(change, u) for _, change in changes]
        if any(derivative(gain, u).value != 0.0 for gain in gains):
            raise InputError("compensator", "is not affine in u; expected x' = f(x) + g(x) u")
        unsteered = {**names, INPUT: zero}
        drift = [(names[name], read_formula(text, tape, unsteered)) for name, text in self.rates.items()]
        steered = [(state, gain) for (state, _), gain in zip(changes, gains)]
        h = read_formula(self.output, tape, {name: names[name] for name in self.rates})
        lies = [h]
        for _ in self.rates:
            through, next_one = rate(lies[-1], [*steered, (u, zero)]), rate(lies[-1], [*drift, (u, zero)])
            lies.append(next_one)
            if through.value != 0.0:
                return tape, lies, through
        raise InputError("compensator", "does not pass u to its output")

    def _check_minimum_phase(self) -> None:
        tape, names, changes = self._system
        n = len(changes)
        h = self._derivatives[1][0]
        rows = [[derivative(change, names[by]) for by in (*self.rates, INPUT)] for _, change in changes]
        rows.append([derivative(h, names[by]) for by in self.rates] + [tape.constant(0.0)])
        values = evaluate(tape, [entry for row in rows for entry in row], dict.fromkeys(names, 0.0))
        pencil = np.array(values, dtype=float).reshape(n + 1, n + 1)
        if not np.isfinite(pencil).all():
            return
        from scipy.linalg import eigvals

        zeros: Array = np.asarray(eigvals(pencil, np.diag([1.0] * n + [0.0])))
        finite = zeros[np.isfinite(zeros) & (np.abs(zeros) < 1e8)]
        if (np.real(finite) > 1e-9).any():
            raise InputError("compensator", f"is not minimum phase: it has a zero at {np.real(finite).max():.3g} 1/s")

    @staticmethod
    def _compiled(name: str, arguments: list[str], tape: Tape, outputs: list[Expr]) -> Callable[..., tuple[float, ...]]:
        space: dict[str, Any] = dict(_MATHS)
        exec(compile(python_function(name, arguments, tape, outputs), f"<{name}>", "exec"), space)
        made: Callable[..., tuple[float, ...]] = space[name]
        return made
