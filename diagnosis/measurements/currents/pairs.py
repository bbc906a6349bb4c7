"""Two effects at one joint that hide each other: alone neither explains what is held out, for it is fitted to what the other does; together they do.

Forward selection stalls before such a pair (a gain of the current and friction by the load, both odd in the load, of opposite sign). Where it has
stalled and the residual of a joint is no noise, all pairs of effects at that joint are looked at.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence, Set

import numpy as np

from arm_io.types import Array
from arm_model.effects import same_columns
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.design_matrix import Columns, Side
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.regression import (
    ALIKE,
    SIGNIFICANT,
    Accepted,
    Pair,
    at_joint,
    best_shapes,
    gain_of,
    matters,
    shadows,
)
from identification.selection.significance import benjamini_hochberg, p_value

MOST = 0.5
"""Share of what is left of a joint that two effects must explain: they are not looked for to explain a part."""


def two_of(
    library: Mapping[Candidate, Pair],
    accepted: Accepted,
    fit: Side,
    held_out: Side,
    joints: Sequence[int],
    taken: Set[EffectKey],
    physical: Callable[[Candidate, Array], bool],
) -> list[Candidate]:
    """The two effects that together explain most of the first of ``joints`` where two do; empty where none do.

    Judged like a single one: by the held-out gain of both at that joint over blocks, with false-discovery control over all pairs of the joint.
    """
    for joint in joints:
        of_joint = {c: pair for c, pair in library.items() if c.joint == joint and not c.unit_amplitude}
        able = best_shapes(of_joint, accepted, fit, set(taken))
        pairs = [
            (one, other)
            for one, other in itertools.combinations(able, 2)
            if other.effect not in same_columns(one.definition)
        ]
        looks = [_gain(one, other, library, accepted, fit, held_out) for one, other in pairs]
        q = benjamini_hochberg(np.array([p_value(held_out.by_block(fall)) for _, fall in looks]))
        shadow = shadows(held_out, accepted)
        most = MOST * float(np.sum(accepted.held_out[held_out.of(joint)] ** 2))
        good = []
        for (one, other), (coefficients, fall), q_one in zip(pairs, looks, q):
            first = library[one][0].x.shape[1]
            fits = physical(one, coefficients[:first]) and physical(other, coefficients[first:])
            gain, by_joint = float(fall.sum()), held_out.by_joint(fall)
            if q_one < SIGNIFICANT and fits and gain > most and matters(by_joint, len(coefficients), shadow, held_out):
                good.append((gain * (1.0 - ALIKE * len(coefficients)), one, other))
        if good:
            _, one, other = max(good, key=lambda each: each[0])
            return [one, other]
    return []


def _gain(
    one: Candidate, other: Candidate, library: Mapping[Candidate, Pair], accepted: Accepted, fit: Side, held_out: Side
) -> tuple[Array, Array]:
    """Coefficients of both (k,) and the fall of the squared held-out error of their joint, row by row."""
    sides = []
    for which, side in enumerate((fit, held_out)):
        columns = [at_joint(library[c][which], one.joint, side) for c in (one, other)]
        sides.append(Columns(np.hstack([c.x for c in columns]), columns[0].where))
    _, coefficients, fall = gain_of((sides[0], sides[1]), accepted, held_out)
    return coefficients, fall
