"""The fewest changes that explain how two groups of recordings differ: forward selection among hypotheses.

Of those that are certain, the one that explains most enters, and the others are tested beside it, until none is
certain. A change that the regressions of single recordings call significant stands only if the shared regression shows
it, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from comparison.change import Change
from comparison.groups.both_sides import Both, Tested, both_sides, shared_values, tested
from comparison.groups.hypotheses import Hypothesis, hypotheses, single_values
from comparison.quantities import friction_maps
from comparison.regression import Fitted, Rows, Structure

GROUP = 2
"""Recordings of each side, at least: what one recording differs in from the next is unknown without another."""
CERTAIN = 1e-3
"""Probability by chance, times the number of hypotheses, of a change that enters."""
MOST = 6
"""Changes at most: an arm that differs in more is another arm."""
SHOWN_TOO = 0.05
"""Probability by chance in the shared regression, times the number of hypotheses, of a change that single regressions
call significant."""


def with_fewest(
    structure: Structure,
    data: Sequence[Rows],
    fits: Sequence[Fitted],
    side: NDArray[np.bool_],
    changes: Sequence[Change],
) -> list[Change]:
    """The changes of all quantities, decided by the shared regression; of single recordings as they are.

    changes: by regressions of single recordings; the last of them are those of the values.
    """
    if min(side.sum(), (~side).sum()) < GROUP:
        return list(changes)
    both = both_sides(structure, data, fits, side)
    every = hypotheses(structure, [one for one, mine in zip(fits, side) if not mine])
    found = selected(both, every)
    chances = _chances(structure, both, every)
    decided = [_stands(one, chances, len(every)) for one in changes]
    if not found:
        return decided
    values, covariance = shared_values(both, structure.model(), found)
    maps = np.nan_to_num(friction_maps(structure, np.diag(covariance))[1])
    maps = np.concatenate([maps, np.eye(structure.size)])
    std = np.sqrt(np.maximum(np.sum(maps @ covariance * maps, axis=1), 0.0))
    for one in found:
        sizes, errors = one.seen_by(maps)
        k = _clearest(one, decided, sizes, errors)
        before, after = (float(maps[k] @ values), float(std[k])), (float(sizes[k]), float(errors[k]))
        decided[k] = _conditional(decided[k], before, after, one, len(every))
    return decided


def selected(both: Both, every: Sequence[Hypothesis]) -> list[Tested]:
    """The hypotheses that entered, each as tested beside the others that did."""
    chosen: list[Hypothesis] = []
    while len(chosen) < MOST:
        rest = [one for one in every if all(one is not other for other in chosen)]
        certain = [one for one in tested(both, rest, chosen) if one.log_p + np.log(len(every)) < np.log(CERTAIN)]
        if not certain:
            break
        chosen.append(max(certain, key=lambda one: one.gain - 2 * one.hypothesis.directions.shape[1]).hypothesis)
    again = []
    for one in chosen:
        others = [other for other in chosen if other is not one]
        # with all that did not enter, as their scatter between recordings is part of what it is judged by
        beside = tested(both, [each for each in every if all(each is not other for other in others)], others)
        again += [each for each in beside if each.hypothesis is one]
    return [one for one in again if one.log_p + np.log(len(every)) < np.log(CERTAIN)]


def _chances(structure: Structure, both: Both, every: Sequence[Hypothesis]) -> dict[str, float]:
    """Name of a quantity -> probability of its change by chance, if nothing else changed."""
    singles = [*(one for one in every if one.quantity), *single_values(structure)]
    return {one.hypothesis.quantity: float(np.exp(one.log_p)) for one in tested(both, singles, [])}


def _stands(change: Change, chances: dict[str, float], count: int) -> Change:
    """The change, not significant where the shared regression does not show it."""
    chance = min(1.0, count * chances.get(change.quantity.name, 1.0))
    if change.significant and change.corrected is not None and chance > SHOWN_TOO:
        return replace(change, corrected=max(change.corrected, chance))
    return change


def _clearest(one: Tested, changes: Sequence[Change], sizes: Array, errors: Array) -> int:
    """The quantity that shows a hypothesis best: its own, or the value that changes by most deviations."""
    own = next((k for k, each in enumerate(changes) if each.quantity.name == one.hypothesis.quantity), None)
    if own is not None and errors[own] > 0.0:
        return own
    # several values, or a level of friction that is compared in one direction only
    first = len(sizes) - len(one.directions)
    return first + int(np.argmax(np.abs(sizes[first:]) / np.maximum(errors[first:], 1e-300)))


def _conditional(
    change: Change, before: tuple[float, float], by: tuple[float, float], one: Tested, count: int
) -> Change:
    """A quantity with its change as the shared regression has it, significant whatever single regressions say.

    before, by: value of the side before, and its change, each with its std
    """
    p = float(np.exp(one.log_p))
    return replace(
        change,
        quantity=replace(change.quantity, why=""),
        before=before[0],
        after=before[0] + by[0],
        std_before=before[1],
        std_after=float(np.hypot(before[1], by[1])),
        std=by[1],
        p=p,
        corrected=min(1.0, p * count),
    )
