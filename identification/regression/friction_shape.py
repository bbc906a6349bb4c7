"""Friction of free shape in the regression: where its speeds lie, its columns beside the others, how it is smoothed.

A joint's curve is a linear spline over its speeds (``arm_model.rigid_body.friction_curve``), so that its values are
coefficients like all others. What they add to Coulomb and viscous friction is smooth over the logarithm of the speed:
second differences are small, of a standard deviation that cross-validation chooses. A hump at low speed and a bend at
high speed are then equally easy to follow, whatever the joint's size (a smoothing spline: Wahba, Spline Models for
Observational Data, 1990).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import FrictionCurve
from arm_model.friction_split import departures
from arm_model.rigid_body.regressor import curve_columns
from identification.preprocessing.signals import (
    Motion,
    equation_rows,
    equation_weight,
    parallel_filter,
    parallel_window,
    with_reversals,
)
from identification.regression.base_parameters import structural_base
from identification.regression.equations import Equations
from identification.regression.least_squares import Fit
from identification.regression.model_parameters import column_names, curve_names
from identification.regression.problem import Problem, excited_of
from identification.regression.uncertainty import FitUncertainty

POINTS = 18
"""Speeds of a curve, at most."""
SLOWEST = 0.01
"""Quantile of the speeds at which a joint surely slides that is the first speed of the curve."""
FASTEST = 0.999
"""The same of its last speed."""
SPAN = 4.0
"""Fastest over slowest speed, at least: less shows no shape."""
SHARE = 0.003
"""Of a joint's sliding samples, between two neighbouring speeds at least."""
FEWEST = 1000
"""Sliding samples of a joint, at least."""
SCALES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Standard deviations of the change of slope per unit of log speed, as shares of the joint's friction."""
FOLDS = 5
"""Parts of the time, each predicted from the others."""


def curve_speeds(motions: Sequence[Motion], j: int) -> tuple[float, ...] | None:
    """rad/s (m/s): speeds of a curve that these motions show at joint j (from 0); None where they show no shape."""
    v = np.concatenate([np.abs(motion.qd[motion.certain[:, j], j]) for motion in motions if motion.moves(j)] or [[]])
    if len(v) < FEWEST:
        return None
    low, high = np.quantile(v, [SLOWEST, FASTEST])
    if high < SPAN * low:
        return None
    speeds = [float(low)]
    for speed in np.geomspace(low, high, POINTS)[1:]:
        if np.mean((v > speeds[-1]) & (v <= speed)) >= SHARE:
            speeds.append(float(speed))
    speeds[-1] = float(high)
    return tuple(speeds) if len(speeds) > 3 else None


def with_curves(problem: Problem, speeds: Mapping[int, tuple[float, ...]]) -> Problem:
    """The problem with friction curves at joints (from 0) that had none, at these speeds and of no value as yet."""
    joints = list(problem.arm.joints)
    for j, speed in speeds.items():
        nothing = (0.0,) * len(speed)
        joints[j] = replace(joints[j], friction_curve=FrictionCurve(speed, nothing, nothing))
    bare, problem = problem, replace(problem, arm=replace(problem.arm, joints=tuple(joints)))
    names = column_names(problem.arm, problem.friction)
    base = structural_base(problem.arm, problem.friction)

    def wider(rows: Equations, motions: Sequence[Motion]) -> Equations:
        old = {name: rows.columns[:, k] for k, name in enumerate(bare.rows.names)}
        new = {name: column for j in speeds for name, column in _columns_of(problem, motions, j).items()}
        return replace(rows, columns=np.stack([(old | new)[name] for name in names], axis=1), names=tuple(names))

    rows = wider(problem.rows, problem.motions)
    return replace(
        problem,
        rows=rows,
        judged=wider(problem.judged, list(map(with_reversals, problem.motions))),
        held=None if problem.held is None else wider(problem.held, problem.held_motions),
        base=base,
        excited=excited_of(rows, base, problem.arm),
    )


def _columns_of(problem: Problem, motions: Sequence[Motion], j: int) -> dict[str, Array]:
    """(rows,) by name: columns of the values of one joint's curve, without those that follow from others."""
    curve = problem.arm.joints[j].friction_curve
    assert curve is not None
    basis, kept = departures(curve.speed)
    ends = ("_positive", "_negative") if problem.friction == "asymmetric" else ("",)
    names = [name for end in ends for name in np.array(curve_names(j, len(basis), end))[kept].tolist()]
    parts = []
    for motion in motions:
        filtered = _filtered(problem, motion, j, basis)
        of, row = np.nonzero(equation_rows(motion)[1].T)
        parts.append(np.where((of == j)[:, None], filtered[row], 0.0))
    return dict(zip(names, np.concatenate(parts).T))


def _filtered(problem: Problem, motion: Motion, j: int, basis: Array) -> Array:
    """(k, columns) of one joint's curve through the parallel filter; a stretch at a time, to save memory."""
    window, step = parallel_window(motion)
    weight, kept = equation_weight(motion)[:, j], (len(motion.t) - window) // step + 1
    stretch, parts = max(1, 4 * window // step), list[Array]()
    for first in range(0, kept, stretch):
        rows = slice(first * step, (min(first + stretch, kept) - 1) * step + window)
        unit = curve_columns(problem.arm, j, motion.qd[rows, j], problem.friction, alone=True)
        unit = np.concatenate([part @ basis for part in np.split(unit, unit.shape[1] // len(basis), axis=1)], axis=1)
        parts.append(parallel_filter(motion, unit * weight[rows, None]))
    return np.concatenate(parts)


@dataclass(frozen=True)
class Smoothness:
    """rows (r, b) over the fitted columns: second differences in units of the joint's friction; joint (r,) from 0."""

    rows: Array
    joint: NDArray[np.intp]


def smoothness(problem: Problem, size: Array) -> Smoothness | None:
    """That of all curves of the arm, whose joints have friction of ``size`` (n,) N m (N); None without a curve."""
    names = [problem.base.names[k] for k in problem.columns]
    found, joints = [], []
    ends = ("_positive", "_negative") if problem.friction == "asymmetric" else ("",)
    for j, joint in enumerate(problem.arm.joints):
        if joint.friction_curve is None:
            continue
        basis, kept = departures(joint.friction_curve.speed)
        bends = _second_differences(_logarithm(joint.friction_curve.speed)) @ basis / size[j]
        for end in ends:
            rows = np.zeros((len(bends), len(names)))
            for column, name in zip(bends.T, np.array(curve_names(j, len(basis), end))[kept].tolist()):
                if name in names:
                    rows[:, names.index(name)] = column
            found.append(rows)
            joints += [j] * len(rows)
    return Smoothness(np.concatenate(found), np.array(joints, np.intp)) if found else None


def _logarithm(speed: Sequence[float]) -> Array:
    """(K,): log of increasing speeds rad/s (m/s); a first speed of 0 counts as 1/1000 of the last, or half the next."""
    # a floor that others may lie below would make two of them equal: moves from point to point creep at their ends
    least = min(1e-3 * speed[-1], 0.5 * speed[1])
    return np.log([speed[0] or least, *speed[1:]])


def _second_differences(x: Array) -> Array:
    """(K - 2, K): changes of slope over x (K,), each over the root of the distance that it happens in."""
    slope = np.diff(np.eye(len(x)), axis=0) / np.diff(x)[:, None]
    return np.asarray(np.diff(slope, axis=0) / np.sqrt((x[2:] - x[:-2]) / 2)[:, None])


def cross_validated_scale(uncertainty: FitUncertainty, fit: Fit, smooth: Smoothness) -> float:
    """The scale of SCALES with which each of FOLDS parts of the time is best predicted from the others.

    uncertainty, fit: of a fit with ``smooth`` at any scale.
    """
    grams, scores = uncertainty.normal
    right = scores + grams @ fit.values
    fold = np.arange(len(grams)) * FOLDS // len(grams)
    parts = [(grams[fold == f].sum(axis=0), right[fold == f].sum(axis=0)) for f in range(FOLDS) if (fold == f).any()]
    total = sum(part[0] for part in parts), sum(part[1] for part in parts)
    unit = 1 / np.sqrt(np.maximum(np.diag(total[0]), 1e-300))

    def error(scale: float) -> float:
        held, found = smooth.rows.T @ smooth.rows / scale**2, 0.0
        for gram, score in parts:
            normal = (total[0] - gram + held) * unit[:, None] * unit
            values = unit * np.linalg.lstsq(normal, unit * (total[1] - score), rcond=1e-12)[0]
            found += float(values @ gram @ values - 2 * values @ score)
        return found

    return min(SCALES, key=error)
