"""The fewest changes that explain how two sides differ, and what they make of the compared quantities.

A change that the regressions of single recordings call significant stands only if the shared regression shows it, too.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from comparison.change import Change
from comparison.joint_fit.added_changes import added_changes
from comparison.joint_fit.effects import Added
from comparison.joint_fit.hypotheses import Hypothesis, chance, single_values, size_with
from comparison.joint_fit.search import JointFit, Recorded, searched
from comparison.joint_fit.selection import rivals_of
from comparison.joint_fit.tested import Tested, shared_values, tested
from comparison.quantities import friction_maps
from comparison.regression import Structure

CONFIRMED = 0.05
"""Probability by chance in the shared regression, times the number of hypotheses, of a change that single regressions
call significant."""
ROUNDING = 1e-9
"""Relative difference below which numbers are equal."""
NOT_SHOWN = "not shown by the regression of all recordings together"


@dataclass(frozen=True)
class AcceptedChange:
    """A hypothesis that entered.

    quantities  names of those that it changes by more than two deviations
    rivals      hypotheses that explain as much in its place
    """

    tested: Tested
    quantities: frozenset[str]
    rivals: Sequence[Hypothesis] = ()


def fewest_changes(
    recorded: Recorded, first: JointFit, changes: Sequence[Change]
) -> tuple[list[Change], list[Change], list[AcceptedChange]]:
    """The changes of all quantities, decided by the shared regression; those of effects beyond the model; what entered.

    first    the joint fit without ripples
    changes  by regressions of single recordings; the last of them are those of the values
    """
    joint = searched(recorded, first)
    structure, found = recorded.structure, joint.found
    chances = _chances(structure, joint, found)
    values, covariance = shared_values(joint.fit, _model(structure, joint.added), found)
    maps = _maps(structure, np.diag(covariance), len(values), _by_scale(recorded))
    seen = [one.seen_by(maps) for one in found]
    involved = np.array([np.abs(sizes) > 2.0 * errors for sizes, errors in seen], bool).reshape(-1, len(changes))
    decided = [
        change if by else _confirmed(change, chances, joint.every)
        for change, by in zip(changes, involved.any(axis=0) & _possible(changes))
    ]
    decided = _with_reasons(decided, changes, structure, joint)
    std = np.sqrt(np.maximum(np.sum(maps @ covariance * maps, axis=1), 0.0))
    for affected, one, (sizes, errors) in zip(involved, found, seen):
        if one.hypothesis.added is None:
            k = _most_significant(one, decided, sizes, errors, structure.size)
            before, after = (float(maps[k] @ values), float(std[k])), (float(sizes[k]), float(errors[k]))
            decided[k] = _conditional(decided[k], before, after, one, joint.every)
            affected[k] = True
    causes = []
    for affected, one, rivals in zip(involved, found, rivals_of(joint.fit, joint.every, found)):
        # without what the others change less beside it
        touched = affected & np.any(maps @ one.hypothesis.directions != 0.0, axis=1)
        quantities = frozenset(change.quantity.name for change, by in zip(decided, touched) if by)
        causes.append(AcceptedChange(one, quantities, [rival.hypothesis for rival in rivals]))
    return decided, added_changes(structure, joint.every, found, values, covariance), causes


def _model(structure: Structure, added: Sequence[Added]) -> Array:
    return np.pad(structure.model(), (0, size_with(structure, added) - structure.size))


def _by_scale(recorded: Recorded) -> Array:
    """(c, J) change of the values of a recording after, per change of scale of a joint's currents."""
    pairs = zip(recorded.fits, recorded.is_before)
    after = [one.by_scale for one, first in pairs if not first and np.isfinite(one.values).any()]
    return np.mean(after, axis=0) if after else np.zeros_like(recorded.fits[0].by_scale)


def _maps(structure: Structure, variance: Array, size: int, by_scale: Array) -> Array:
    """(r, c) how the compared quantities follow from the values, and from those of a joint fit that come after them."""
    count = structure.size
    maps = np.concatenate([np.nan_to_num(friction_maps(structure, variance[:count])[1]), np.eye(count)])
    effects = np.zeros((len(maps), size - count - by_scale.shape[1]))
    return np.concatenate([maps, effects, maps @ by_scale], axis=1)


def _chances(
    structure: Structure, joint: JointFit, found: Sequence[Tested], names: Collection[str] | None = None
) -> dict[str, float]:
    """Name of a quantity (None: all) -> logarithm of its chance beside what was found."""
    singles = [*(one for one in joint.every if one.quantity), *single_values(structure, joint.added)]
    singles = [one for one in singles if names is None or one.quantity in names]
    given = tested(joint.fit, singles, [one.hypothesis for one in found])
    return {one.hypothesis.quantity: one.log_p for one in given}


def _possible(changes: Sequence[Change]) -> NDArray[np.bool_]:
    return np.array([change.significant for change in changes], bool)


def _confirmed(change: Change, chances: dict[str, float], every: Sequence[Hypothesis]) -> Change:
    """The change, not significant where the shared regression does not show it."""
    shared = _shared_chance(change, chances, every)
    if change.significant and change.corrected is not None and shared > CONFIRMED:
        return replace(change, corrected=max(change.corrected, shared))
    return change


def _shared_chance(change: Change, chances: dict[str, float], every: Sequence[Hypothesis]) -> float:
    return min(1.0, float(np.exp(chance(chances.get(change.quantity.name, 0.0), every))))


def _with_reasons(
    decided: Sequence[Change], changes: Sequence[Change], structure: Structure, joint: JointFit
) -> list[Change]:
    """The changes; those significant only in regressions of single recordings get the reason why they do not count.

    What the shared regression shows as long as nothing is known of a change that was found follows from that.
    """
    lost = [now for now, then in zip(decided, changes) if then.significant and not now.significant]
    if not lost:
        return list(decided)
    names = {one.quantity.name for one in lost}
    unknown = _chances(structure, joint, [], names)
    given = [(one.hypothesis.words, _chances(structure, joint, [one], names)) for one in joint.found]
    reasons: dict[str, str] = {}
    for one in lost:
        reasons[one.quantity.name] = NOT_SHOWN
        if _shared_chance(one, unknown, joint.every) <= CONFIRMED:
            by = [words for words, chances in given if _shared_chance(one, chances, joint.every) > CONFIRMED]
            reasons[one.quantity.name] = f"follows from {' and '.join(by or [words for words, _ in given])}"
    return [replace(change, overruled=reasons.get(change.quantity.name, "")) for change in decided]


def _most_significant(one: Tested, changes: Sequence[Change], sizes: Array, errors: Array, values: int) -> int:
    """The quantity that shows a hypothesis best: its own, or the value that changes by most deviations."""
    place = next((k for k, each in enumerate(changes) if each.quantity.name == one.hypothesis.quantity), None)
    if place is not None and errors[place] > 0.0:
        return place
    # several values, or a level of friction that is compared in one direction only
    first = len(sizes) - values
    clear = np.abs(sizes[first:]) / np.maximum(errors[first:], 1e-300)
    if one.hypothesis.what == "scale":
        # one coefficient: all values change by as many deviations; of its joint, that which a recording shows best
        of = changes[first : len(sizes)]
        clear = np.array([abs(size) / each.std if each.std else 0.0 for size, each in zip(sizes[first:], of)])
        clear *= [each.quantity.joint == one.hypothesis.joint for each in of]
    # a mass changes several values by as many deviations, but for rounding: the first of them
    return first + int(np.argmax(clear >= (1.0 - ROUNDING) * clear.max()))


def _conditional(
    change: Change, before: tuple[float, float], by: tuple[float, float], one: Tested, every: Sequence[Hypothesis]
) -> Change:
    """A quantity with its change as the shared regression has it, significant whatever single regressions say.

    before, by: value of the side before, and its change, each with its std
    """
    return replace(
        change,
        quantity=replace(change.quantity, why=""),
        before=before[0],
        after=before[0] + by[0],
        std_before=before[1],
        std_after=float(np.hypot(before[1], by[1])),
        std=by[1],
        p=float(np.exp(one.log_p)),
        corrected=min(1.0, float(np.exp(chance(one.log_p, every)))),
        overruled="",
    )
