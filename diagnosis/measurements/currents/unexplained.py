"""Structure that no effect of the catalogue explains: smooth functions of one variable, conditional on the causes.

For every joint and every variable that a torque or a reading could depend on, a spline of the variable (also times the
direction, or times the velocity, of the joint) is fitted together with the causes and scored on the held-out recordings
like a cause. What enters is structure that the catalogue does not contain. A cause that such a function makes
superfluous approximates something else, and is removed: a spring that fits part of a wavy torque over position is no
spring.

A function that is fitted to some recordings says nothing of values that these do not reach: of a joint that turns from
0 to 1.2 rad in the fitted recordings and from -1.2 to 1 rad in the held-out one. Where a residual is above the noise,
that there is something to explain needs no proof: every function is then fitted to all recordings, fitted and held out,
less some seconds of each, and predicts these. So is a drift of each recording's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm
from diagnosis.cause import NO_VARIABLE, Signal, Structure
from diagnosis.measurements.currents.basis_functions import Shape, shapes_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model_errors import Significance
from diagnosis.residual.noise.channels import quiet_noise
from diagnosis.selection.design import Columns, Dataset, Pair, joined
from diagnosis.selection.drift import levels, own_lines
from diagnosis.selection.regression import Fitted, fit_gain, gain_of, residual_with
from diagnosis.selection.waves import wave_of
from identification.selection import Split, p_value

FOLDS = 4
"""Parts of the rows, each predicted from all others."""
FOLD_BLOCKS = 3
"""Consecutive blocks (s) of a fold: longer than what a slow residual keeps of its past, short against a motion."""
PENALTY = 1e-3
"""Of a function that is predicted, relative to the mean Gram diagonal: decides where only the predicted rows pass."""


@dataclass(frozen=True)
class Unexplained:
    """Structures, and the columns that describe them.

    likely: joint -> columns of the variable on which a residual above the noise most likely depends.
    """

    structures: list[Structure]
    pairs: list[Pair]
    likely: dict[int, Pair]


def unexplained_structure(data: Split[Dataset], fitted: Fitted, arm: Arm, significance: Significance) -> Unexplained:
    """Structures conditional on what is ``fitted``, joint by joint, the strongest first.

    significance: of columns beside those fitted, with the model as uncertain as it is.
    """
    joints = range(1, len(arm) + 1)
    found = in_parallel(lambda joint: structures_at(joint, data, fitted, arm, significance), joints)
    return Unexplained(
        [structure for structures, _, _ in found for structure in structures],
        [pair for _, pairs, _ in found for pair in pairs],
        {joint: likely for joint, (_, _, likely) in zip(joints, found) if likely},
    )


def structures_at(
    joint: int, data: Split[Dataset], fitted: Fitted, arm: Arm, significance: Significance
) -> tuple[list[Structure], list[Pair], Pair | None]:
    """Structures at one joint, their columns, and those of a likely variable.

    The memory of a joint's shapes is freed before the next joint.
    """
    structures: list[Structure] = []
    pairs: list[Pair] = []
    fit, held_out = data
    known = np.ones(held_out.rows, bool)
    shapes = list(shapes_of(fit, held_out, fitted.fit, arm, joint))
    for _ in range(LIMITS.structures):
        best = _strongest(shapes, with_columns(fitted, pairs), data, joint, significance, known)
        if best is None:
            break
        shape, share = best
        structures.append(Structure(Signal.CURRENT, joint, shape.name, share))
        pairs.append(shape.pair)
        known &= shape.known
        shapes = [one for one in shapes if one.name != shape.name]
    beside = with_columns(fitted, pairs).held_out
    ratio = noise_ratio(beside, held_out, joint)
    if ratio <= LIMITS.above_noise * significance.allowed(held_out, joint):
        return structures, pairs, None
    likely = likely_variable(data, Split(fitted.fit, fitted.held_out), arm, joint)
    if likely is not None:
        name, pair, share = likely
        rows = held_out.of(joint)
        left = float(np.sum(beside[rows] ** 2)) / float(np.sum(fitted.held_out[rows] ** 2))
        if not pairs or 1.0 - share < LIMITS.swapped * left:
            return [Structure(Signal.CURRENT, joint, name, share)], [], pair
    if not pairs:
        against = wave_of(fitted.held_out, held_out, joint) or NO_VARIABLE
        structures.append(Structure(Signal.CURRENT, joint, against, 0.0, f"{ratio:.1f} times the noise"))
    return structures, pairs, None


def likely_variable(data: Split[Dataset], left: Split[Array], arm: Arm, joint: int) -> tuple[str, Pair, float] | None:
    """The variable whose function explains most of what is left at a joint (from 1), its columns, and the share of it.

    left: whitened residuals (n * rows,) of both sides. None where no function explains half of it
    (``LIMITS.likely_share``).
    """
    every = joined(data, left)
    own = every.of(joint)
    y, block = every.y[own], every.block[own]
    fold = block // FOLD_BLOCKS % FOLDS
    best, most = None, LIMITS.likely_share * float(np.sum(y**2))
    for name, x, bends in _functions(every, y, fold, arm, joint):
        fall = y**2 - (y - _predicted(x, y, fold, bends)) ** 2
        gain = float(fall.sum())
        if gain > most and p_value(np.bincount(block, weights=fall).astype(float)) < LIMITS.likely_p:
            best, most = (name, x), gain
    if best is None:
        return None
    (fit, held_out), (name, x) = data, best
    pair = Split(Columns(x[: fit.rows], fit.of(joint)), Columns(x[fit.rows :], held_out.of(joint)))
    return name, pair, most / float(np.sum(y**2))


def _functions(
    every: Dataset, y: Array, fold: NDArray[np.intp], arm: Arm, joint: int
) -> Iterator[tuple[str, Array, Array | None]]:
    """Name, columns (rows, k) and ``Shape.bends`` of every function; of a drift, where a constant is not as good."""
    for shape in shapes_of(every, every, every.y, arm, joint):
        yield shape.name, shape.pair.fit.x, shape.bends if shape.bends.size else None
    constants, lines = levels(every, joint), own_lines(every, joint)
    left, left_by_lines = (float(np.sum((y - _predicted(x, y, fold)) ** 2)) for x in (constants, lines))
    if left_by_lines < (1.0 - LIMITS.likely_share) * left:
        yield "time", lines, None


def _predicted(x: Array, y: Array, fold: NDArray[np.intp], bends: Array | None = None) -> Array:
    """(rows,) of each fold from the coefficients of columns x (rows, k) in the others, by penalised least squares.

    Penalised is what bends where few rows pass (Eilers & Marx, Statistical Science 11, 1996), so that a function goes
    on straight beyond them; by default the coefficients, so that it goes to zero.
    """
    predicted, here = np.zeros_like(y), [fold == k for k in range(FOLDS)]
    grams, toward = [x[k].T @ x[k] for k in here], [x[k].T @ y[k] for k in here]
    whole = sum(grams)
    penalty = np.eye(x.shape[1]) if bends is None else bends.T @ bends
    penalty = PENALTY * float(np.mean(np.diag(whole))) * penalty
    for k, rows in enumerate(here):
        predicted[rows] = x[rows] @ np.linalg.lstsq(whole - grams[k] + penalty, sum(toward) - toward[k], rcond=None)[0]
    return predicted


def joints_above_noise(residual: Array, side: Dataset, arm: Arm) -> list[int]:
    """Joints whose ``residual`` (n * rows,) exceeds the noise, the largest residual-to-noise ratio first."""
    by_joint = {joint: noise_ratio(residual, side, joint) for joint in range(1, len(arm) + 1)}
    return sorted(
        (joint for joint, value in by_joint.items() if value > LIMITS.above_noise), key=lambda joint: -by_joint[joint]
    )


def noise_ratio(residual: Array, side: Dataset, joint: int) -> float:
    """Residual-to-noise ratio of a joint: rms of ``residual`` (n * rows,) over the noise std, where the joint moves.

    1 for noise; less where the instruments are better than their noise std says.

    Only rows count in which the noise is that of the instruments. Noise correlated over longer than the initial
    standstill is underestimated; it is as large in the quietest seconds as in all others, and then the ratio is 1.
    """
    known = side.comparable(joint)
    if not known.any():
        return 1.0
    own, block = residual[side.of(joint)], side.block[side.of(joint)]
    ratio = float(np.sqrt(np.mean(own[known] ** 2)))
    quiet = float(quiet_noise(own[:, None], known[:, None], block)[0])
    return ratio if ratio > LIMITS.far_above_noise or ratio > 1.5 * quiet else min(ratio, 1.0)


def better_than_causes(
    data: Split[Dataset], without: Fitted, with_causes: Fitted, arm: Arm, joint: int, allowed: float
) -> dict[str, float]:
    """Variables of which one function leaves significantly less than the causes of a joint (``without`` them).

    Each with the squared held-out error by which it leaves less.

    Functions of one variable only approximate a true cause, but may explain more than a wrong one. allowed: squared
    error by which the function may be worse, where there are implausibly many causes; not for the velocity, on which
    several effects depend.
    """
    fit, held_out = data
    rows, better = held_out.of(joint), dict[str, float]()
    for shape in shapes_of(fit, held_out, without.fit, arm, joint):
        _, c = fit_gain(shape.pair.fit, without)
        by_function = residual_with(shape.pair, c, without, held_out)
        improvement = (with_causes.held_out**2 - by_function**2)[rows] * shape.known
        blocks = np.bincount(held_out.block[rows], weights=improvement).astype(float)
        gain = float(blocks.sum())
        significant = gain > LIMITS.structure_gain * held_out.rows and p_value(blocks) < LIMITS.structure_p
        if significant or (allowed and shape.name != "velocity" and gain > -allowed):
            better[shape.name] = max(gain, better.get(shape.name, gain))
    return better


def _strongest(
    shapes: Sequence[Shape],
    fitted: Fitted,
    data: Split[Dataset],
    joint: int,
    significance: Significance,
    known: NDArray[np.bool_],
) -> tuple[Shape, float] | None:
    """The function that explains most of a joint's held-out residual, and the share of its variance.

    Judged where the variable is in the range that was fitted: beyond it, a function says nothing, and neither do
    coefficients of causes that were fitted beside it. known (rows,): where functions that are fitted already do.
    """
    held_out = data.held_out
    rows = held_out.of(joint)
    gains = []
    for shape in shapes:
        fall = gain_of(shape.pair, fitted, held_out)[1]
        fall[rows] *= shape.known & known
        gains.append(held_out.by_block(fall))
    q = stats.false_discovery_control(np.array([p_value(gain) for gain in gains]))
    before = float(np.sum(fitted.held_out[rows] ** 2 * known))
    explained = float(np.sum(held_out.y[rows] ** 2 * known)) - before
    enough = max(LIMITS.structure_gain * held_out.rows, LIMITS.structure_share * explained)
    significant = [k for k, gain in enumerate(gains) if q[k] < LIMITS.structure_p and gain.sum() > enough]
    significant = [k for k in significant if significance.beyond_model(shapes[k].pair, LIMITS.beyond_model)]
    if not significant:
        return None
    best = max(significant, key=lambda k: float(gains[k].sum()))
    return shapes[best], float(gains[best].sum()) / before


def with_columns(fitted: Fitted, more: Sequence[Pair]) -> Fitted:
    """The fit with more columns, fitted to its residual."""
    for pair in more:
        x, x_held_out = pair.fit.dense(len(fitted.fit)), pair.held_out.dense(len(fitted.held_out))
        inside = fitted.basis.T @ x
        x, x_held_out = x - fitted.basis @ inside, x_held_out - fitted.to_held_out @ inside
        u, s, vt = np.linalg.svd(x, full_matrices=False)
        keep = s > 1e-4 * s[0]
        basis, to_held_out = u[:, keep], x_held_out @ (vt[keep].T / s[keep])
        projected = basis.T @ fitted.fit
        fitted = Fitted(
            fitted.fit - basis @ projected,
            fitted.held_out - to_held_out @ projected,
            np.hstack([fitted.basis, basis]),
            np.hstack([fitted.to_held_out, to_held_out]),
            fitted.coefficients,
        )
    return fitted
