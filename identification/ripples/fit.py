"""Waves of one joint fitted together beside the columns of the arm: torque, order and phase with their covariance.

A wave a cos(O (q - q0)) + b sin(O (q - q0)) is linear but for its order O (rad per rad or m of the joint), which is
found by Gauss-Newton steps. q0, the middle of the travel, makes order and phase independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.regression.uncertainty import student_factor
from identification.ripples.rows import Side, WideRows
from identification.selection import scaled_lstsq
from identification.selection.cluster_covariance import cluster_covariance

STEPS = 4
"""Gauss-Newton steps of the orders."""
WHOLE_WITHIN = 2.0
"""Deviations of an order within which whole turns of a shaft are taken for it."""
UNAMBIGUOUS = 6.0
"""Deviations of an order that whole turns of a shaft must be apart, at least, for one of them to be meant."""


@dataclass(frozen=True)
class Wave:
    """An order (rad per rad or m of the joint); whole: it is one of whole turns of ``turn``, and not fitted."""

    order: float
    turn: str = ""

    @property
    def whole(self) -> bool:
        """Whether the order is exact."""
        return bool(self.turn)


@dataclass(frozen=True)
class Fitted:
    """Waves at a joint (from 0): amplitudes (w, 2) N m (N) of cosine and sine about ``middle`` rad (m).

    covariance  (3 w, 3 w) of cosine, sine and order of each
    left        residuals (k,), (l,) of the fitted and the held-out rows, over the noise
    """

    waves: tuple[Wave, ...]
    amplitudes: Array
    middle: float
    covariance: Array
    residual: tuple[Array, Array]

    def parameters(self, k: int, ratio: float) -> tuple[tuple[float, float, float], Array]:
        """Torque N m (N), order per turn of the motor and phase at angle 0 of the k-th wave, and covariance (3, 3)."""
        (a, b), order = self.amplitudes[k], self.waves[k].order
        torque = float(np.hypot(a, b))
        phase = float(np.angle(np.exp(1j * (np.arctan2(a, b) - order * self.middle))))
        slope = np.array(
            [
                [a / torque, b / torque, 0.0],
                [0.0, 0.0, 1.0 / ratio],
                [b / torque**2, -a / torque**2, -self.middle],
            ]
        )
        of_wave = slice(3 * k, 3 * k + 3)
        return (torque, order / ratio, phase), slope @ self.covariance[of_wave, of_wave] @ slope.T


def fit_waves(rows: WideRows, joint: int, waves: Sequence[Wave]) -> Fitted:
    """The waves at a joint (from 0) by least squares of the fitted rows; orders that are not exact are refined."""
    if not waves:
        return Fitted((), np.zeros((0, 2)), 0.0, np.zeros((0, 0)), rows.residual)
    angles = np.concatenate([motion.q[:, joint] for motion in rows.fit.motions])
    middle = float(angles.min() + angles.max()) / 2
    travel = float(np.ptp(angles))
    found = list(waves)
    free = [k for k, wave in enumerate(waves) if not wave.whole]
    amplitudes = np.zeros((len(waves), 2))
    for step in range(STEPS + 1):
        fitted, held_out = _linear(rows, joint, found, middle)
        values = scaled_lstsq(fitted, rows.residual[0])
        amplitudes = values.reshape(-1, 2)
        bent = _bent(rows, joint, found, middle, amplitudes, free)
        if step == STEPS or not free:
            break
        by = scaled_lstsq(np.hstack([fitted, bent]), rows.residual[0])[fitted.shape[1] :]
        most = np.pi / travel
        for k, change in zip(free, np.clip(by, -most / 4, most / 4)):
            found[k] = Wave(found[k].order + float(change))
    residual = rows.residual[0] - fitted @ values, rows.residual[1] - held_out @ values
    covariance = _covariance(np.hstack([fitted, bent]), residual[0], rows.fit, free, len(waves))
    return Fitted(tuple(found), amplitudes, middle, covariance, residual)


def _linear(rows: WideRows, joint: int, waves: Sequence[Wave], middle: float) -> tuple[Array, Array]:
    """(k, 2 w), (l, 2 w) cosine and sine of each wave in the fitted and the held-out rows, beside the arm's columns."""

    def columns(side: Side) -> Array:
        angles = [motion.q[:, joint] - middle for motion in side.motions]
        torques = [np.stack([f(w.order * q) for w in waves for f in (np.cos, np.sin)], axis=1) for q in angles]
        return side.whitened(rows.arm, joint, torques)

    return rows.without_other_columns(columns(rows.fit), columns(rows.held_out))


def _bent(
    rows: WideRows, joint: int, waves: Sequence[Wave], middle: float, amplitudes: Array, free: Sequence[int]
) -> Array:
    """(k, f) derivative of the fitted rows by the orders that are free."""
    if not free:
        return np.zeros((len(rows.residual[0]), 0))
    torques = []
    for motion in rows.fit.motions:
        q = motion.q[:, joint] - middle
        slopes = [
            q * (amplitudes[k, 1] * np.cos(waves[k].order * q) - amplitudes[k, 0] * np.sin(waves[k].order * q))
            for k in free
        ]
        torques.append(np.stack(slopes, axis=1))
    columns = rows.fit.whitened(rows.arm, joint, torques)
    return rows.without_other_columns(columns, np.zeros((len(rows.residual[1]), columns.shape[1])))[0]


def _covariance(columns: Array, residual: Array, side: Side, free: Sequence[int], waves: int) -> Array:
    """(3 w, 3 w) by blocks of time, never below that of white residuals; two standard deviations cover 95 %."""
    count = int(side.block.max()) + 1
    robust = cluster_covariance(columns, [residual], side.block)
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    gram = np.linalg.pinv((columns / size).T @ (columns / size), hermitian=True) / np.outer(size, size)
    white = gram * float(residual @ residual) / max(len(residual) - columns.shape[1], 1)
    known = robust * student_factor(count - 1) ** 2
    raised = np.sqrt(np.maximum(1.0, np.diag(white) / np.maximum(np.diag(known), 1e-300)))
    known = known * np.outer(raised, raised)
    whole = np.zeros((3 * waves, 3 * waves))
    place = np.array([3 * (k // 2) + k % 2 for k in range(2 * waves)] + [3 * k + 2 for k in free])
    whole[np.ix_(place, place)] = known
    return whole


def with_whole_turns(fitted: Fitted, k: int, ratio: float, revolute: bool) -> Wave:
    """The k-th wave, with the whole turns of the motor, or of the joint, that its order does not differ from."""
    wave = fitted.waves[k]
    std = float(np.sqrt(fitted.covariance[3 * k + 2, 3 * k + 2]))
    shafts = [("motor", ratio), ("joint", 1.0)] if revolute else [("motor", ratio)]
    for name, turn in shafts:
        whole = float(np.rint(wave.order / turn)) * turn
        if whole > 0.0 and abs(whole - wave.order) < WHOLE_WITHIN * std and turn > UNAMBIGUOUS * std:
            return Wave(whole, name)
    return wave
