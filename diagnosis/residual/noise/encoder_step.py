"""The step of an encoder or converter, from its samples alone: the spacing of the lattice on which these lie.

A fine encoder passes many steps between two rows, so that neighbouring rows say little of its step. Sorted by size, the
values of a motion lie at distances that are whole multiples of the step, and the shortest of them at small ones. The
step is their greatest common divisor. Each distance is only nearly a multiple: counts are scaled by a gear ratio,
converted to radians, kept in 32 bits, printed with some digits.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array

SAME = 1e-12
"""Of the largest value: values that differ by less are one."""
MOST = 4096
"""Shortest distances that decide."""
STARTS = 8
"""Shortest distances that are divided for a first step."""
DIVISORS = 64
"""Largest divisor of such a distance."""
SCREENED = 64
"""Shortest distances by which steps are screened."""
EXACT = 0.03
"""Of a step, rms: distances between values of a lattice that are off whole multiples by less, whatever their number."""
ALIKE = 0.9
"""Share of distances of the same number of steps, above which only their sum decides: they may be the way per row."""
ROUNDED = 0.13
"""Of a step, rms: values that are off one lattice by less over their whole range. Numbers that were printed with a
last digit of 0.45 steps are."""
REFITTED = 3
"""Times that a step is fitted to all values: the shortest distances are those that rounding made shorter."""
FEWEST = 40
"""Exact distances that decide alone: fewer of a motion at nearly constant speed are nearly equal."""
MANY = 200
"""Rounded distances that decide alone."""
REPEATED = 4
"""Times on average that rows repeat every value, of which any number decides."""


KEPT = 1024
"""Answers that each function of ``found_once`` keeps in memory."""

P = ParamSpec("P")
R = TypeVar("R")


def found_once(find: Callable[Concatenate[Array, P], R]) -> Callable[Concatenate[Array, P], R]:
    """Caches ``find`` by the bytes of its samples (m,), because a diagnosis asks for the same angles a dozen times.

    Other arguments must be plain numbers. The result is shared and must not be changed.
    """
    found: dict[tuple[bytes, str], R] = {}

    @wraps(find)
    def kept(values: Array, *args: P.args, **kwargs: P.kwargs) -> R:
        same = hashlib.blake2b(np.asarray(values, float).tobytes(), digest_size=16).digest(), repr((args, kwargs))
        if same not in found:
            if len(found) >= KEPT:
                found.pop(next(iter(found)), None)
            found[same] = find(values, *args, **kwargs)
        return found[same]

    return kept


@found_once
def encoder_step(values: Array) -> float:
    """Spacing of the lattice on which (m,) samples lie, in their unit; 0 where they lie on none, or never change.

    The coarsest one: of counts that were printed with some digits the count, unless the last digit is coarser. Noise
    before the quantisation does not matter. Values that were filtered after it lie on no lattice, as those of an
    instrument without steps.
    """
    sorted_values = np.unique(values[np.isfinite(values)])
    if len(sorted_values) < 2:
        return 0.0
    resolved = np.diff(sorted_values) > SAME * max(np.abs(sorted_values[[0, -1]]).max(), 1e-300)
    sorted_values = sorted_values[np.concatenate([[True], resolved])]
    distances = np.diff(sorted_values)
    repeated = len(values) >= REPEATED * len(sorted_values)
    if len(distances) == 0 or not (repeated or len(distances) >= FEWEST):
        return 0.0
    shortest = np.sort(np.partition(distances, MOST)[:MOST] if len(distances) > MOST else distances)
    for step in _proposed(shortest):
        refined = _refined(np.array([step]), shortest)[0]
        multiples = np.rint(shortest / refined)
        informative = repeated or np.mean(multiples == np.median(multiples)) < ALIKE
        if informative and np.sqrt(np.mean(_off(shortest, refined) ** 2)) < EXACT:
            return float(refined)
        if repeated or len(distances) >= MANY:
            over_all, off = _one_lattice(sorted_values, float(refined))
            if off < ROUNDED:
                return over_all
    return 0.0


def as_readings(values: Array, measured: NDArray[np.bool_]) -> Array:
    """(m, J) samples, of which those that were not ``measured`` (m, J) are what the instrument would have read there.

    Interpolated values lie between its steps: 18 rows in 10 000 made a step of an encoder look a fifth of it.
    """
    readings = values.copy()
    for column, known in zip(readings.T, measured.T):
        if known.any() and not known.all() and (step := encoder_step(column[known])):
            origin = column[known][0]
            column[~known] = origin + step * np.rint((column[~known] - origin) / step)
    return readings


def _proposed(shortest: Array) -> Array:
    """Steps of which the shortest distances (k,), ascending, are nearly whole multiples; the largest first.

    Of a motion at nearly constant speed all distances are long, and differ by few steps: differences of distances are
    multiples of the step as well.
    """
    between = np.diff(shortest)
    between = np.sort(between[between > SAME * shortest[-1]])
    proposed = []
    for multiples in (shortest, between):
        if len(multiples):
            first = (multiples[:STARTS, None] / np.arange(1, DIVISORS + 1)).ravel()
            steps = _refined(first, multiples[:SCREENED])
            off = _off(multiples[:SCREENED], steps[:, None])
            proposed.append(steps[np.sqrt(np.mean(off**2, axis=1)) < 1.5 * ROUNDED])
    steps = np.sort(np.concatenate(proposed))[::-1]
    # many starts lead to the same step
    return steps[np.concatenate([[True], np.diff(steps) < -1e-6 * steps[:-1]])] if len(steps) else steps


def _refined(steps: Array, multiples: Array) -> Array:
    """(s,) steps fitted to distances (k,), ascending, which are nearly whole multiples of each.

    Twice as many distances at a time: a step that is known by short ones is precise enough to count the longer ones.
    Then all of them twice more: a distance may have been counted with a step that the others corrected since.
    """
    count = 1
    while True:
        chosen = multiples[:count]
        counts = np.maximum(np.rint(chosen / steps[:, None]), 0.0)
        squares = np.sum(counts**2, axis=1)
        steps = np.where(squares > 0.0, counts @ chosen / np.where(squares > 0.0, squares, 1.0), steps)
        if count >= 4 * len(multiples):
            return steps
        count *= 2


def _off(distances: Array, step: Array | float) -> NDArray[np.float64]:
    """Distances less the nearest multiple of ``step``, in steps."""
    counts = distances / step
    return np.asarray(counts - np.rint(counts), float)


def _one_lattice(sorted_values: Array, step: float) -> tuple[float, float]:
    """Step of the lattice nearest to all values (k,), ascending; rms in steps by which they are off it.

    Values of a motion at nearly constant speed lie at nearly the same distances as well, but drift against a lattice.
    """
    about = sorted_values - sorted_values.mean()
    for _ in range(REFITTED):
        counts = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(sorted_values) / step))])
        counts -= counts.mean()
        squares = float(counts @ counts)
        if squares == 0.0:
            return step, np.inf
        step = float(counts @ about) / squares
    return step, float(np.std(about - step * counts)) / step
