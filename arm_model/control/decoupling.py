"""The thesis's disturbance-decoupling controller (chapter 7, sections 7.5 and 7.6): one scalar loop per joint.

To each loop, the other links' pull and the water are a disturbance. A loop joins three small systems:

* tracking model S_t, z -> y_t: how the joint must follow its reference z,
* compensator S_m, u -> y_m (``arm_model.control.compensator``): stands in for the joint; invertible, minimum phase,
* regulation filter S_r, eps = y - y_m -> y_r: unit gain, faster than what S_m has wrong and what disturbs.

The torque keeps the extended output y_E = -y_m + y_t - y_r at zero. Differentiated d = d_m times (the relative degree
of S_m; d_t, d_r >= d_m must hold, or no such law exists), with L the Lie derivative along x_m' = f + g u, y_m = h:

    y_E^(d) = -L_f^d h + D u + C_t A_t^d x_t + C_t A_t^(d-1) b_t z - C_r A_r^d x_r - C_r A_r^(d-1) b_r (y - h)
    D = -L_g L_f^(d-1) h

The law sets y_E^(d) = -V, V = a_0 y_E + a_1 y_E' + ..., so that p(s) y_E = 0 with p(s) = s^d + ... + a_1 s + a_0:

    u = (-V + L_f^d h - C_t A_t^d x_t - C_t A_t^(d-1) b_t z + C_r A_r^d x_r + C_r A_r^(d-1) b_r (y - h)) / D

From then on the tracking error is y_t - y = y_r - eps: it dies with the speed of S_r. The loop knows neither masses nor
lengths nor water. The compensator is driven by the torque that the drives gave, so that a limit does not wind it up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm_io import InputError, counted
from arm_io.types import Array
from arm_model.control.compensator import Compensator
from arm_model.control.computed_torque import Reference
from arm_model.control.linear_model import LinearModel


@dataclass(frozen=True)
class DecouplingLoop:
    """One joint's controller. ``gains``: a_0, a_1, ... of p(s), one per derivative, with p Hurwitz.

    Raises InputError where the relative degrees do not allow the law, S_r has no unit gain, or p is not Hurwitz.
    """

    tracking: LinearModel
    compensator: Compensator
    regulation: LinearModel
    gains: tuple[float, ...]

    def __post_init__(self) -> None:
        d = self.compensator.relative_degree
        for name, model in (("tracking model", self.tracking), ("regulation filter", self.regulation)):
            if model.relative_degree < d:
                raise InputError(
                    name, f"has relative degree {model.relative_degree}; expected at least the compensator's {d}"
                )
        if len(self.gains) != d or not (np.roots([1.0, *self.gains[::-1]]).real < 0).all():
            raise InputError("gains", f"are {self.gains}; expected {d} that make s^{d} + ... + a_1 s + a_0 Hurwitz")
        unit = -float(self.regulation.c @ np.linalg.solve(self.regulation.a, self.regulation.b))
        if abs(unit - 1.0) > 1e-6:
            raise InputError("regulation filter", f"has gain {unit:.6g} at rest; expected 1")

    def law(self, x_t: Array, x_m: Array, x_r: Array, z: float, y: float) -> float:
        """u (N m or N): reference ``z`` and measured ``y`` in rad (m); states of the three systems."""
        *lies, through = self.compensator.lie(*x_m)
        if through == 0.0 or not np.isfinite(through):
            raise InputError("compensator", f"has no inverse at its state {x_m.tolist()}")
        d = len(self.gains)
        filtered = self.tracking.rows[: d + 1] @ x_t - self.regulation.rows[: d + 1] @ x_r
        extended = filtered - lies  # y_E and its derivatives, the last without the inputs
        into_t, into_r = self._inputs
        return float((extended @ [*self.gains, 1.0] + into_t * z - into_r * (y - lies[0])) / through)

    @cached_property
    def _inputs(self) -> tuple[float, float]:
        """What z and y - h add to the d-th derivative of y_t and y_r."""
        d = len(self.gains)
        return self.tracking.markov(d - 1), self.regulation.markov(d - 1)


class _LoopState:
    """Where the three systems of a loop stand."""

    def __init__(self, loop: DecouplingLoop, period: float) -> None:
        self.loop = loop
        self.x_t, self.x_r = np.zeros(len(loop.tracking.b)), np.zeros(len(loop.regulation.b))
        self.x_m = np.zeros(len(loop.compensator.rates))
        self.step_t, self.step_r = loop.tracking.sampled(period), loop.regulation.sampled(period)
        self.period = period

    def torque(self, z: float, y: float) -> float:
        return self.loop.law(self.x_t, self.x_m, self.x_r, z, y)

    def advance(self, z: float, y: float, given: float) -> None:
        eps = y - self.loop.compensator.lie(*self.x_m)[0]
        self.x_t = self.step_t[0] @ self.x_t + self.step_t[1] * z
        self.x_r = self.step_r[0] @ self.x_r + self.step_r[1] * eps
        self.x_m = self.loop.compensator.advance(self.x_m, given, self.period)

    @property
    def tracked(self) -> float:
        return float(self.loop.tracking.c @ self.x_t)


class DisturbanceDecoupling:
    """A loop per joint, called every ``period`` s.

    Positions count from ``start`` (n,) rad (m), where the arm rests at the beginning: all systems start at zero. Of a
    ``Reference`` it uses only the position. ``tracked``: (n,) positions y_t demanded of the joints at each call so far.
    """

    def __init__(self, loops: Sequence[DecouplingLoop], *, period: float, start: Array) -> None:
        if len(loops) != len(start) or period <= 0:
            raise InputError(
                "loops",
                f"are {len(loops)} for {counted(len(start), 'joint')}, every {period:g} s; expected one per joint",
            )
        self.start = np.asarray(start, dtype=float)
        self.tracked: list[Array] = []
        self._states = [_LoopState(loop, period) for loop in loops]
        self._reference = np.zeros(len(loops))

    def torque(self, q: Array, qd: Array, reference: Reference) -> Array:
        """(n,) joint torque, N m (N), before any limit."""
        self._reference = reference.q - self.start
        self.tracked.append(self.start + [state.tracked for state in self._states])
        pairs = zip(self._states, self._reference, q - self.start)
        return np.array([state.torque(float(z), float(y)) for state, z, y in pairs])

    def observe(self, q: Array, qd: Array, applied: Array) -> None:
        """What the drives give until the next call, (n,) N m (N), at the state of the last."""
        for state, z, y, given in zip(self._states, self._reference, q - self.start, applied):
            state.advance(float(z), float(y), float(given))
