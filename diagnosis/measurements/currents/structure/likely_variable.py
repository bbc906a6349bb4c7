"""The variable on which a residual above the noise most likely depends.

A function that is fitted to some recordings says nothing of values that these do not reach: of a joint that turns from
0 to 1.2 rad in the fitted recordings and from -1.2 to 1 rad in the held-out one. Where a residual is above the noise,
that there is something to explain needs no proof: every function is then fitted to all recordings, fitted and held out,
less some seconds of each, and predicts these. So is a drift of each recording's own. A cause is held against such a
function in the same way: fitted to some recordings alone, a drift of another one's own is never taken out of that one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.structure.basis_functions import shapes_of
from diagnosis.measurements.currents.structure.drift import levels, own_lines
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.selection.design import Columns, Dataset, Pair, joined
from identification.selection import Split, p_value

FOLDS = 4
"""Parts of the rows, each predicted from all others."""
FOLD_BLOCKS = 3
"""Consecutive blocks (s) of a fold: longer than what a slow residual keeps of its past, short against a motion."""
PENALTY = 1e-3
"""Of a function that is predicted, relative to the mean Gram diagonal: decides where only the predicted rows pass."""


DRIFT = "time"
"""The variable of a drift of each recording's own."""
NEGLIGIBLE = 1e-6
"""The same of columns of causes, whose scales differ: decides nothing but what no row determines."""


class Likely(NamedTuple):
    """A variable on which a residual most likely depends: columns of its function, and the share that it explains.

    bends: ``Shape.bends`` of the columns, if they are values at knots.
    """

    variable: str
    pair: Pair
    share: float
    bends: Array | None = None


def likely_variable(data: Split[Dataset], residual: Split[Array], arm: Arm, joint: int) -> Likely | None:
    """The variable whose function explains most of the residual of a joint (from 1).

    residual: whitened (n * rows,) of each part of ``data``. None where no function explains the share
    ``LIMITS.likely_share`` of it.
    """
    every = joined(data, residual)
    rows = every.of(joint)
    y, block = every.y[rows], every.block[rows]
    fold = block // FOLD_BLOCKS % FOLDS
    best, best_gain = None, LIMITS.likely_share * float(np.sum(y**2))
    for name, x, bends in _functions(every, y, fold, arm, joint):
        fall = y**2 - (y - _predicted(x, y, fold, bends)) ** 2
        gain = float(fall.sum())
        if gain > best_gain and p_value(np.bincount(block, weights=fall).astype(float)) < LIMITS.likely_p:
            best, best_gain = (name, x, bends), gain
    if best is None:
        return None
    (fit, held_out), (name, x, bends) = data, best
    pair = Split(Columns(x[: fit.rows], fit.of(joint)), Columns(x[fit.rows :], held_out.of(joint)))
    return Likely(name, pair, best_gain / float(np.sum(y**2)), bends)


def share_kept(likely: Likely, own: Pair, others: Sequence[Pair], data: Split[Dataset]) -> float:
    """Share of what a cause explains that it still explains conditional on the function of a likely variable.

    By predictions of all recordings, less some seconds of each, with the ``others``; 0 where it predicts nothing.
    """
    every = joined(data, data.map(lambda side: side.y))
    fold = every.block // FOLD_BLOCKS % FOLDS
    causes = [_scaled(_dense(pair, data)) for pair in others]
    cause, function = _scaled(_dense(own, data)), _dense(likely.pair, data)

    def energy(*columns: Array, given: bool) -> float:
        x = np.hstack([*causes, *columns, function if given else function[:, :0]])
        penalty = np.zeros((x.shape[1], x.shape[1]))
        first = x.shape[1] - function.shape[1] if given else x.shape[1]
        penalty[:first, :first] = NEGLIGIBLE * np.eye(first)
        penalty[first:, first:] = _penalty(function, likely.bends) if given else 0.0
        return float(np.sum((every.y - _by_folds(x, every.y, fold, penalty)) ** 2))

    alone, kept = (energy(given=given) - energy(cause, given=given) for given in (False, True))
    return kept / alone if alone > 0.0 else 0.0


def _dense(pair: Pair, data: Split[Dataset]) -> Array:
    """(n * rows, k): columns over all rows of ``joined``."""
    sides = (columns.dense(len(side.y)).reshape(-1, side.rows, columns.x.shape[1]) for columns, side in zip(pair, data))
    both = np.concatenate(list(sides), axis=1)
    return both.reshape(-1, both.shape[2])


def _scaled(x: Array) -> Array:
    """Columns x (m, k) of unit length; those that are 0 stay so."""
    length = np.sqrt(np.sum(x**2, axis=0))
    return np.asarray(x / np.where(length > 0.0, length, 1.0))


def _functions(
    every: Dataset, y: Array, fold: NDArray[np.intp], arm: Arm, joint: int
) -> Iterator[tuple[str, Array, Array | None]]:
    """Name, columns (rows, k) and ``Shape.bends`` of every function; of a drift, where a constant is not as good."""
    for shape in shapes_of(Bases(every, every), every.y, arm, joint):
        yield shape.name, shape.functions.fit.columns.x, shape.bends if shape.bends.size else None
    constants, lines = levels(every, joint), own_lines(every, joint)
    energy, energy_of_lines = (float(np.sum((y - _predicted(x, y, fold)) ** 2)) for x in (constants, lines))
    if energy_of_lines < (1.0 - LIMITS.likely_share) * energy:
        yield DRIFT, lines, None


def _predicted(x: Array, y: Array, fold: NDArray[np.intp], bends: Array | None = None) -> Array:
    """(rows,) of each fold from the coefficients of columns x (rows, k) in the others, by penalised least squares.

    Penalised is what bends where few rows pass (Eilers & Marx, Statistical Science 11, 1996), so that a function goes
    on straight beyond them; by default the coefficients, so that it goes to zero.
    """
    return _by_folds(x, y, fold, _penalty(x, bends))


def _penalty(x: Array, bends: Array | None) -> Array:
    """(k, k) of the coefficients of a function's columns x (rows, k)."""
    penalty = np.eye(x.shape[1]) if bends is None else bends.T @ bends
    return np.asarray(PENALTY * float(np.mean(np.sum(x**2, axis=0))) * penalty)


def _by_folds(x: Array, y: Array, fold: NDArray[np.intp], penalty: Array) -> Array:
    """(rows,) of each fold from the coefficients in the others, with a ``penalty`` (k, k)."""
    predicted, in_fold = np.zeros_like(y), [fold == k for k in range(FOLDS)]
    grams, toward = [x[k].T @ x[k] for k in in_fold], [x[k].T @ y[k] for k in in_fold]
    total = sum(grams)
    for k, rows in enumerate(in_fold):
        predicted[rows] = x[rows] @ np.linalg.lstsq(total - grams[k] + penalty, sum(toward) - toward[k], rcond=None)[0]
    return predicted
