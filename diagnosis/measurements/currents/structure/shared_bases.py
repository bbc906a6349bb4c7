"""Splines and waves of variables that several joints may depend on, each computed once.

The position of joint 2 is a variable of every joint: of the functions of all joints of a six-joint arm, five of six are
of such variables.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from arm_model import Arm
from diagnosis.measurements.currents.structure.unseen_friction import unseen_friction
from diagnosis.residual.signals import signals_of
from diagnosis.selection.design import Dataset
from diagnosis.selection.unseen_inertia import unseen_inertia

KNOTS = 16
"""Knots of a function of one variable: enough for three cycles over the range of a joint."""
WAVE_STEPS = np.arange(0.5, 8.01, 0.5)
"""rad per rad (m) of an angle: waves over the angles of two joints."""


def variables(side: Dataset, arm: Arm, joint: int) -> Iterator[tuple[str, Array]]:
    """Name and values (rows,) of every variable that the residual of this joint may depend on.

    Currents are those that the model expects, as in the laws of transducers (``signals_of``): the measured one has the
    residual in it, so that a function of it explains more than the gain that is wrong.
    """
    yield "time", np.concatenate([run.t for run in side.runs])
    yield "position", side.at_joint("q", joint)
    yield "motor angle", np.mod(side.at_joint("q", joint) * arm.joints[joint - 1].ratio, 2 * np.pi)
    yield "velocity", side.at_joint("v", joint)
    yield "acceleration", side.at_joint("a", joint)
    yield "load torque", side.at_joint("rigid", joint)
    yield "current", _expected_current(side, arm, joint)
    for other in range(1, len(arm) + 1):
        if other != joint:
            yield f"position of joint {other}", side.at_joint("q", other)
            yield f"velocity of joint {other}", side.at_joint("v", other)
            yield f"current of joint {other}", _expected_current(side, arm, other)


def _expected_current(side: Dataset, arm: Arm, joint: int) -> Array:
    """(rows,) A at a joint (from 1)."""
    return np.concatenate([np.asarray(signals_of(run, arm, joint).current) for run in side.runs])


@dataclass(frozen=True)
class Splines:
    """Natural cubic splines of one variable, each 1 at its knot and 0 at all others.

    fit, held_out  (rows, KNOTS); 0 in held-out rows beyond the range that was fitted
    known          (rows,): held-out rows within it
    bends          (KNOTS - 2, KNOTS), see ``bends_of``
    """

    fit: Array
    held_out: Array
    known: NDArray[np.bool_]
    bends: Array


class Bases:
    """Splines of the variables of a fit set and a held-out set, and waves over angles, as they are asked for."""

    def __init__(self, fit: Dataset, held_out: Dataset) -> None:
        self.fit, self.held_out = fit, held_out
        self._splines: dict[str, Splines | None] = {}
        self._harmonics: dict[int, Array] = {}

    @cached_property
    def unseen(self) -> tuple[Array, ...]:
        """Each (n rows,) of the held-out residual: what folds onto the acceleration, and friction near rest."""
        return unseen_inertia(self.held_out.runs), unseen_friction(self.held_out.runs)

    def compute(self, arm: Arm) -> None:
        """Computes everything that several joints need, before they are processed in parallel."""
        for joint in range(1, len(arm) + 1) if len(arm) > 1 else ():
            self.harmonics(joint)
            for _ in self.splines(arm, joint):
                pass

    def splines(self, arm: Arm, joint: int) -> Iterator[tuple[str, Splines]]:
        """Name and splines of every variable of a joint (from 1) that varies."""
        of_sides = variables(self.fit, arm, joint), variables(self.held_out, arm, joint)
        for (name, x), (_, x_held_out) in zip(*of_sides):
            if name == "motor angle":
                continue  # by its harmonics
            key = name if name == "time" or " of joint " in name else f"{name} of joint {joint}"
            if key not in self._splines:
                self._splines[key] = _splines_of(x, x_held_out, same=self.fit is self.held_out)
            if (found := self._splines[key]) is not None:
                yield name, found

    def harmonics(self, joint: int) -> Array:
        """``harmonics_of`` the fitted angles of a joint (from 1)."""
        if joint not in self._harmonics:
            self._harmonics[joint] = harmonics_of(self.fit.at_joint("q", joint))
        return self._harmonics[joint]


def _splines_of(x: Array, x_held_out: Array, *, same: bool) -> Splines | None:
    """Splines of a variable of values (rows,) in both sets, which may be the ``same``; None of a constant one."""
    if np.ptp(x) == 0.0:
        return None
    # half of the knots by rows, half evenly: the ends of the range have few rows, but matter
    knots = (np.quantile(x, np.linspace(0.0, 1.0, KNOTS)) + np.linspace(x.min(), x.max(), KNOTS)) / 2
    if np.any(np.diff(knots) <= 0.0):
        return None  # practically constant
    in_range = (x_held_out >= knots[0]) & (x_held_out <= knots[-1])
    in_fit = splines_at(x, knots)
    in_held_out = (in_fit if same else splines_at(x_held_out, knots)) * in_range[:, None]
    return Splines(in_fit, in_held_out, in_range, bends_of(knots))


def splines_at(x: Array, knots: Array) -> Array:
    """(rows, knots) natural cubic splines, each 1 at its knot and 0 at all others; constant beyond the ends."""
    values: Array = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")(np.clip(x, knots[0], knots[-1]))
    return values


def bends_of(knots: Array) -> Array:
    """(knots - 2, knots) second derivative at the inner knots of a function of these values, per mean spacing^2."""
    below, above = np.diff(knots)[:-1], np.diff(knots)[1:]
    second = np.zeros((len(knots) - 2, len(knots)))
    inner = np.arange(len(knots) - 2)
    second[inner, inner], second[inner, inner + 2] = 2.0 / (below * (below + above)), 2.0 / (above * (below + above))
    second[inner, inner + 1] = -2.0 / (below * above)
    return second * float(np.mean(np.diff(knots))) ** 2


def harmonics_of(angle: Array) -> Array:
    """(2 steps, m): cosines, then sines, of the waves of ``WAVE_STEPS`` over an angle (m,)."""
    wave = np.exp(1j * WAVE_STEPS[0] * angle)
    powers = np.multiply.accumulate(np.broadcast_to(wave, (len(WAVE_STEPS), len(wave))), axis=0)
    return np.concatenate([powers.real, powers.imag])
