"""Two effects at one joint that mask each other: alone neither predicts the held-out residual, together they do.

Alone, each is fitted to the effect of the other. Forward selection stalls before such a pair (a current gain and load
friction, both odd in the load, of opposite sign). Where it has stalled and the residual of a joint exceeds
the noise, all pairs of effects at that joint are scored.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence, Set

import numpy as np
from scipy import stats

from arm_model.effects import same_columns
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.design_matrix import Library
from diagnosis.measurements.currents.limits import LIMITS, leakage, matters
from diagnosis.measurements.currents.possible import is_physical
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset, Pair
from diagnosis.selection.regression import Fitted, at_joint, best_of_each, chance, gain_of, side_by_side
from identification.selection import Split


def pair_of(
    library: Library,
    fitted: Fitted,
    data: Split[Dataset],
    joints: Sequence[int],
    taken: Set[EffectKey],
) -> list[Candidate]:
    """The two effects that together explain most of the first of ``joints`` where two do; empty where none do.

    Judged like a single one: by the held-out gain of both at that joint over blocks, with false-discovery control over
    all pairs of the joint.
    """
    held_out = data.held_out
    allowance = leakage(held_out, fitted)
    for joint in joints:
        of_joint = [c for c in library if c.joint == joint and not c.unit_amplitude]
        pairs = distinct_pairs(best_of_each(of_joint, library.at_own_joint, fitted, taken))
        both = [_both(one, other, library, data) for one, other in pairs]
        gains = [gain_of(pair, fitted, held_out) for pair in both]
        chances = [chance(pair, *gain, fitted, held_out) for pair, gain in zip(both, gains)]
        q = stats.false_discovery_control(np.array(chances))
        least = LIMITS.pair_share * float(np.sum(fitted.residual.held_out[held_out.of(joint)] ** 2))
        admissible = []
        for (one, other), (c, fall), q_pair in zip(pairs, gains, q):
            first = library[one].fit.x.shape[1]
            fits = is_physical(one, c[:first]) and is_physical(other, c[first:])
            gain, significant = float(fall.sum()), LIMITS.fdr is not None and q_pair < LIMITS.fdr
            if significant and fits and gain > least and matters(held_out.by_joint(fall), len(c), allowance, held_out):
                admissible.append((gain * (1.0 - LIMITS.tie * len(c)), one, other))
        if admissible:
            _, one, other = max(admissible, key=lambda scored: scored[0])
            return [one, other]
    return []


def distinct_pairs(candidates: Sequence[Candidate]) -> list[tuple[Candidate, Candidate]]:
    """All pairs of candidates but those of the same columns, of which the difference is free."""
    pairs = itertools.combinations(candidates, 2)
    return [(one, other) for one, other in pairs if other.effect not in same_columns(one.definition)]


def _both(one: Candidate, other: Candidate, library: Library, data: Split[Dataset]) -> Pair:
    """Columns of both at their joint, side by side."""

    def stacked(columns: Sequence[Columns], part: Dataset) -> Columns:
        own = [at_joint(c, one.joint, part) for c in columns]
        return side_by_side(own)

    pairs = library[one], library[other]
    return Split(stacked([p.fit for p in pairs], data.fit), stacked([p.held_out for p in pairs], data.held_out))
