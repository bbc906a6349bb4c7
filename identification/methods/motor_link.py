"""Identification of one joint that moves alone: inertia, viscous and direction-dependent Coulomb friction, gravity.

The equation of the one joint is

    tau = I q'' + B q' + g1 cos q + g2 sin q + f1 [q' > 0] - f2 [q' < 0],     tau = abs(gear) k i

Two ways around differentiating noise (Abderrahim, "Modelling of Robotic Manipulators", thesis, Glasgow, section 5.2):

* state-variable filter: every term through C(s) = 1 / (1 + s / lambda)^3, whose states are the filtered signal's own
  derivatives (eq 5.11-5.17), then least squares;
* the equation integrated once (from row to row), so that only q' is left to find (eq 5.18-5.22), solved by the
  pseudo-inverse from the SVD.

What other joints do to this one is taken for its own inertia and friction: with several joints moving, or one held by a
servo that gives way, the values are not the joint's (the thesis's table 5.2).
``identification.methods.inverse_dynamics`` is for that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import linalg, signal
from scipy.integrate import cumulative_trapezoid

from arm_io.types import Array
from identification.preprocessing.setpoint_ripple import drifting
from identification.preprocessing.signals import Motion, longest_stretch, smooth_motion
from identification.regression.equations import Equations
from identification.regression.least_squares import Fit, least_squares
from identification.regression.uncertainty import FitUncertainty, fit_uncertainty

Way = Literal["filter", "integral"]

MEMORY = 8.0
"""Time constants of the state-variable filter, (1 + s / lambda)^-3, until all but 1.4 % is forgotten."""
PASSING = 0.02
"""Share of rows in a direction of motion: fewer rows are the transient of a filter."""
RANK = 1e-6
"""Share of the largest singular value, below which a direction is not excited."""


@dataclass(frozen=True)
class MotorLink:
    """names and values of the fit.

    Inertia kg m2 (kg), viscous N m s/rad, gravity_cos, gravity_sin N m, coulomb_positive, coulomb_negative N m, as far
    as asked for; rows, fit and uncertainty behind them.
    """

    names: tuple[str, ...]
    rows: Equations
    fit: Fit
    uncertainty: FitUncertainty

    def value(self, name: str) -> float:
        """The estimate of one of the ``names``."""
        return float(self.fit.values[self.names.index(name)])

    @property
    def gravity(self) -> float:
        """Largest gravity torque, M g l, N m."""
        return float(np.hypot(self.value("gravity_cos"), self.value("gravity_sin")))


def motor_link(
    t: Array, q: Array, torque: Array, *, gravity: bool = True, way: Way = "filter", bandwidth: float | None = None
) -> MotorLink:
    """Fits the pair to t (n,) s, q (n,) rad or m, joint torque (n,) N m or N; the run begins at standstill.

    ``gravity`` False leaves its two columns out. ``bandwidth`` Hz of the filter; by default that of the motion's own
    spectrum.
    """
    motion = smooth_motion(t, q[:, None], torque[:, None])
    return motor_link_of(motion, 0, gravity=gravity, way=way, bandwidth=bandwidth)


def motor_link_of(
    motion: Motion, joint: int, *, gravity: bool = True, way: Way = "filter", bandwidth: float | None = None
) -> MotorLink:
    """The same from a motion that is smooth already, of ``joint`` (from 0)."""
    return fitted(joined([motor_link_rows(motion, joint, gravity=gravity, way=way, bandwidth=bandwidth)]), way)


def joined(runs: Sequence[Equations]) -> Equations:
    """Rows of several runs of one joint, without the Coulomb friction of a direction in which none moves."""
    columns = np.concatenate([rows.columns for rows in runs])
    amount = np.abs(columns).sum(axis=0)
    coulomb = np.array([name.startswith("coulomb") for name in runs[0].names])
    seen = ~coulomb | (amount > PASSING * amount[coulomb].max())
    number = np.concatenate([np.full(len(rows), k, np.intp) for k, rows in enumerate(runs)])
    names = tuple(name for name, there in zip(runs[0].names, seen) if there)
    torque, t = (np.concatenate([getattr(rows, name) for rows in runs]) for name in ("torque", "t"))
    unseen = [np.zeros((len(rows), 0)) if rows.systematic is None else rows.systematic for rows in runs]
    systematic = linalg.block_diag(*unseen)  # each run's clocks have a phase of their own
    return Equations(
        columns[:, seen],
        torque,
        np.zeros(len(torque), np.intp),
        number,
        t,
        names,
        systematic=systematic if systematic.shape[1] else None,
    )


def fitted(rows: Equations, way: Way) -> MotorLink:
    """The pair that explains the rows best."""
    if way == "filter":
        fit = least_squares(rows.columns, rows.torque, rows.joint, "ols")
    else:
        fit = _pseudo_inverse(rows)
    return MotorLink(rows.names, rows, fit, fit_uncertainty(rows.columns, rows, fit))


def motor_link_rows(
    motion: Motion, joint: int, *, gravity: bool, way: Way = "filter", bandwidth: float | None
) -> Equations:
    """The rows that are solved, about five a period of the bandwidth."""
    q, sign = motion.q[:, joint], np.sign(motion.qd[:, joint])
    torque, folded = motion.torque[:, joint], None if motion.folded is None else motion.folded[:, joint]
    terms = {"gravity_cos": np.cos(q), "gravity_sin": np.sin(q)} if gravity else {}
    terms |= {"coulomb_positive": (sign > 0).astype(float), "coulomb_negative": -(sign < 0).astype(float)}
    # A filter with a memory longer than one motion would leave no row that is free of standstill.
    stretch = longest_stretch(motion.usable[:, joint]) * motion.dt
    widest = 2 * MEMORY / (2 * np.pi * stretch) if stretch > 0 else 0.0
    bandwidth = bandwidth or max(motion.band.parallel, widest)
    step = max(1, int(1 / (5 * bandwidth * motion.dt)))
    if way == "filter":
        speed, acceleration = _filtered(q, motion.dt, bandwidth)[1:]
        columns = [acceleration, speed, *(_filtered(term, motion.dt, bandwidth)[0] for term in terms.values())]
        torque = _filtered(torque, motion.dt, bandwidth)[0]
        folded = None if folded is None else _filtered(folded, motion.dt, bandwidth)[0]
        memory = int(MEMORY / (2 * np.pi * bandwidth * motion.dt))
    else:
        # Integrated from row to row, not from the start: an error at one reversal then affects no other row.
        over = {name: _window(_integral(term, motion.dt), step) for name, term in terms.items()}
        columns = [_window(motion.qd[:, joint], step), _window(q, step), *over.values()]
        torque = _window(_integral(torque, motion.dt), step)
        folded = None if folded is None else _window(_integral(folded, motion.dt), step)
        memory = step
    # A row remembers: one that rests on a standstill, where Coulomb's law says nothing, is as useless as the
    # standstill.
    spoilt = np.cumsum(np.concatenate([np.ones(memory + 1), ~motion.usable[:, joint]]))
    kept = np.zeros(len(q), bool)
    kept[::step] = True
    kept &= spoilt[memory + 1 :] - spoilt[: -memory - 1] == 0
    index = np.zeros(int(kept.sum()), np.intp)
    names = ("inertia", "viscous", *terms)
    unseen = None if folded is None else drifting(folded, motion.t)[kept]
    return Equations(
        np.stack(columns, axis=1)[kept], torque[kept], index, index, motion.t[kept], names, systematic=unseen
    )


def _window(x: Array, step: int) -> Array:
    """What x gained over the last ``step`` rows."""
    gained = np.zeros_like(x)
    gained[step:] = x[step:] - x[:-step]
    return gained


def _filtered(x: Array, dt: float, bandwidth: float) -> tuple[Array, Array, Array]:
    """x and its first two derivatives after C(s), exact for a signal that is linear between rows.

    The signal is taken to be at rest before the first row.
    """
    pole = 2 * np.pi * bandwidth
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(pole**3), -3 * pole**2, -3 * pole]])
    system = (a, np.array([[0.0], [0.0], [pole**3]]), np.eye(3), np.zeros((3, 1)))
    discrete = signal.cont2discrete(system, dt, method="foh")
    # States of the first-order hold are shifted by a part of the input: at rest x_state = A x + B u.
    start = np.linalg.solve(np.eye(3) - discrete[0], discrete[1] * x[0])[:, 0]
    _, y, _ = signal.dlsim((*discrete[:4], dt), x[:, None], x0=start)
    return y[:, 0], y[:, 1], y[:, 2]


def _integral(x: Array, dt: float) -> Array:
    return np.asarray(cumulative_trapezoid(x, dx=dt, initial=0))


def _pseudo_inverse(rows: Equations) -> Fit:
    """Least squares by the SVD, without the directions that the motion does not show."""
    scale = np.linalg.norm(rows.columns, axis=0)
    scale[scale == 0] = 1.0
    u, s, vt = linalg.svd(rows.columns / scale, full_matrices=False)
    shown = s > RANK * s[0]
    values = (vt[shown].T @ ((u[:, shown].T @ rows.torque) / s[shown])) / scale
    residual = rows.torque - rows.columns @ values
    return Fit(values, np.ones(len(residual)), residual, np.diag(s[shown]))
