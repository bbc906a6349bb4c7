"""Coupling of the wrist's gears: motors of the wrist that turn with those of other axes.

In the wrist of a Puma the motors of axes 5 and 6 turn with those of 4 and 5. Where the controller compensates it and
the model does not, the recorded motor angle of an axis departs from its own demand by what the others turn: q_j -
qref_j = -sum_k c_jk q_k. The error of the servo depends on the axis's own demand, its speed, acceleration and
direction. Only what depends on another motor instead, in held-out recordings, is a coupling.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model.effects.wrist import WRIST_COUPLING
from daq.recording import Recording
from diagnosis.cause import Estimate
from diagnosis.residual.noise.channels import angle_noise
from diagnosis.residual.signals import direction_of
from diagnosis.screening.event import Event, Gain
from identification.selection import BLOCK_SECONDS, Thresholds, p_value, scaled_lstsq
from identification.selection.cluster_covariance import cluster_covariance, numbered_on

Index = NDArray[np.intp]

PAIRS = ((5, 4), (6, 4), (6, 5))
"""Axis that turns, motor that turns it; from 1."""
OWN = 4
"""Columns of the servo's own error."""


@dataclass(frozen=True, kw_only=True)
class CouplingLimits(Thresholds):
    """What a coupling must satisfy in held-out rows.

    explained    share that it must explain of the squared difference that the servo leaves
    significant  probability below which its gain over blocks is not chance
    noise        times the noise of the angle that the motors must turn the axis
    stds         how many std a coefficient must be from zero
    """

    explained: float = 0.9
    significant: float = 0.05
    noise: float = 20.0
    stds: float = 3.0


LIMITS = CouplingLimits()


@dataclass(frozen=True)
class CoupledAxis:
    """One axis whose motor turns with others; coefficients and std (m,) of ``motors``.

    before, after: rms rad of the held-out difference of motor and demand without and with the coupling; p: probability
    that the gain is chance.
    """

    axis: int
    motors: tuple[int, ...]
    coefficients: Array
    std: Array
    before: float
    after: float
    p: float


@dataclass(frozen=True)
class _Rows:
    """Rows of one axis.

    difference  (m,) rad of motor and demand
    columns     (m, OWN + motors) of the servo and of the motors that may turn the axis
    block       (m,) from 0
    """

    difference: Array
    columns: Array
    block: Index

    @property
    def own(self) -> Array:
        return self.columns[:, :OWN]


def wrist_coupling(fit: Sequence[Recording], held_out: Sequence[Recording]) -> list[Event]:
    """The coupling of the wrist, from motor angles against demands.

    Empty where there is none, or no demand is recorded. Parts of the same recordings are predicted from each other.
    """
    with_demand = [
        [r for r in side if r.qref is not None and r.joints >= 6 and not np.isnan(r.qref).any()]
        for side in (fit, held_out)
    ]
    if not all(with_demand):
        return []
    coupled = [
        axis_result
        for axis in (5, 6)
        if (axis_result := _coupled_axis(with_demand[0], with_demand[1], axis)) is not None
    ]
    if not coupled:
        return []
    coefficients = {
        (axis_result.axis, m): (float(c), float(s))
        for axis_result in coupled
        for m, c, s in zip(axis_result.motors, axis_result.coefficients, axis_result.std)
    }
    rows = [Estimate(f"c{a}{m}", *coefficients.get((a, m), (0.0, 0.005)), "1") for a, m in PAIRS]
    parts = ", ".join(
        f"{-100 * c:.1f} % of the angle of motor {m} at axis {axis}" for (axis, m), (c, _) in coefficients.items()
    )
    strongest = max(coupled, key=lambda axis_result: axis_result.before**2 - axis_result.after**2)
    sentence = (
        f"motors deviate from the demands of their own axes by {parts}: with it, the held-out difference of motor "
        f"{strongest.axis} and demand falls from {strongest.before:.3g} to {strongest.after:.3g} rad rms"
    )
    every = tuple(range(len(fit) + len(held_out)))
    gain = Gain(
        before=strongest.before,
        after=strongest.after,
        unit="rad",
        joint=strongest.axis,
        p=max(axis_result.p for axis_result in coupled),
    )
    return [
        Event(effect=WRIST_COUPLING.name, joint=None, parameters=rows, evidence=sentence, recordings=every, gain=gain)
    ]


def _coupled_axis(fit: Sequence[Recording], held_out: Sequence[Recording], axis: int) -> CoupledAxis | None:
    """The motors that turn the motor of an axis; None where held-out recordings show none."""
    motors = tuple(motor for turned, motor in PAIRS if turned == axis)
    sides = _rows(fit, axis, motors), _rows(held_out, axis, motors)
    parts = bool({r.path for r in fit} & {r.path for r in held_out})
    without, residual, gains = [], [], []
    for source, target in [sides, *([sides[::-1]] if parts else [])]:
        without.append(target.difference - target.own @ _solved(source.own, source.difference))
        residual.append(target.difference - target.columns @ _solved(source.columns, source.difference))
        gains.append(np.bincount(target.block, weights=without[-1] ** 2 - residual[-1] ** 2))
    before, after = (float(np.sqrt(np.mean(np.concatenate(values) ** 2))) for values in (without, residual))
    p = p_value(np.concatenate(gains))
    source = sides[0]
    values = _solved(source.columns, source.difference)
    turns = float(np.std(source.columns[:, OWN:] @ values[OWN:]))
    noise = float(np.mean([angle_noise(r.q[:, [axis - 1]])[0] for r in fit]))
    # in each fold: a gain in one part only is no coupling
    both_ways = all(
        np.sum(after_**2) < (1.0 - LIMITS.explained) * np.sum(without_rows**2)
        for without_rows, after_ in zip(without, residual)
    )
    if not both_ways or p > LIMITS.significant or turns < LIMITS.noise * noise:
        return None
    std = _std(source, values)[OWN:]
    significant = np.abs(values[OWN:]) > LIMITS.stds * std
    if not significant.any():
        return None
    turning = tuple(m for m, there in zip(motors, significant) if there)
    return CoupledAxis(axis, turning, values[OWN:][significant], std[significant], before, after, p)


def _rows(recordings: Sequence[Recording], axis: int, motors: Sequence[int]) -> _Rows:
    """All recordings one after the other, each with its mean removed: a constant is an offset, not a coupling."""
    differences, columns, blocks = [], [], []
    for r in recordings:
        assert r.qref is not None
        demand = r.qref[:, axis - 1]
        speed = np.gradient(demand, r.dt)
        basis = [demand, speed, np.gradient(speed, r.dt), direction_of(speed)]
        x = np.column_stack([*basis, *(-r.q[:, m - 1] for m in motors)])
        y = r.q[:, axis - 1] - demand
        columns.append(x - x.mean(axis=0))
        differences.append(y - y.mean())
        blocks.append(((r.t - r.t[0]) // BLOCK_SECONDS).astype(np.intp))
    return _Rows(np.concatenate(differences), np.concatenate(columns), numbered_on(blocks))


def _solved(x: Array, y: Array) -> Array:
    return scaled_lstsq(x, y, 1e-8)


def _std(rows: _Rows, values: Array) -> Array:
    """Standard deviations of ``values``, for residuals that are correlated within a block."""
    covariance = cluster_covariance(rows.columns, [rows.difference - rows.columns @ values], rows.block)
    return np.hypot(np.sqrt(np.diag(covariance)), LIMITS.systematic * np.abs(values))
