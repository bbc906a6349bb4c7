"""The variable on which a residual above the noise most likely depends.

A function that is fitted to some recordings says nothing of values that these do not reach: of a joint that turns from
0 to 1.2 rad in the fitted recordings and from -1.2 to 1 rad in the held-out one. Where a residual is above the noise,
that there is something to explain needs no proof: every function is then fitted to all recordings, fitted and held out,
less some seconds of each, and predicts these. So is a drift of each recording's own.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.structure.basis_functions import shapes_of
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.selection.design import Columns, Dataset, Pair, joined
from diagnosis.selection.drift import levels, own_lines
from identification.selection import Split, p_value

FOLDS = 4
"""Parts of the rows, each predicted from all others."""
FOLD_BLOCKS = 3
"""Consecutive blocks (s) of a fold: longer than what a slow residual keeps of its past, short against a motion."""
PENALTY = 1e-3
"""Of a function that is predicted, relative to the mean Gram diagonal: decides where only the predicted rows pass."""


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
    for shape in shapes_of(Bases(every, every), every.y, arm, joint):
        yield shape.name, shape.functions.fit.columns.x, shape.bends if shape.bends.size else None
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
