"""Forward selection with joint refit and backward deletion, judged on held-out recordings.

The whitened residual is y = A b + X c + e: A the columns of causes accepted so far, X those of a candidate. Which shape of a candidate fits
best is decided on the fit recordings; whether it enters, on the held-out ones: their squared error must fall by more than its scatter over blocks
allows (``identification.selection.significance``), with false-discovery control over all effects that were looked at, and by an amount that matters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from arm_io.types import Array
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.design_matrix import Columns, Side
from diagnosis.selection.candidate import Candidate
from identification.selection.significance import benjamini_hochberg, p_value, shift_p_value

Pair = tuple[Columns, Columns]

SIGNIFICANT = 0.05
"""False-discovery rate at which a candidate may enter."""
FEW_BLOCKS, LARGE = 0.15, 0.25
"""... and at which one may that gains more than this share of a joint's noise energy: what shows in few blocks has no more of them to be sure by, and
without an effect gains stay below a fiftieth."""
SHARE_OF_NOISE, FOLLOWS = 0.1, 8
"""A gain below this share of one joint's noise energy, for every so many coefficients, does not matter: the effect is a third of the noise, the noise
is known no better, and many coefficients follow something."""
SHADOW, OF_CORRECTED = 1e-5, 0.01
"""A gain below the first share of what is already explained at a joint, or the second of what an exact model had to put right there, may be the rest
of what columns of the first order have wrong: 0.3 % of an effect, a tenth of its second order."""
ALIKE = 0.005
"""Candidates whose gains differ by less than this share of the best, for every coefficient that it has more, are the same to this data."""

INDEPENDENT = 1e-3
"""Relative singular value below which columns of unit length are one: what the data says there is rounding and the columns' own errors."""
NEAR, SURE = 0.8, 0.01
"""A candidate with this share of the best gain is told from it where chance would do so with less than this probability."""


@dataclass(frozen=True)
class Look:
    """One candidate beside the accepted ones: its coefficients, gains in units of noise variance, and the held-out gain by block and by joint."""

    candidate: Candidate
    coefficients: Array
    fit_gain: float
    held_out_gain: float
    p: float
    blocks: Array = field(repr=False)
    by_joint: Array = field(repr=False)


@dataclass(frozen=True)
class Accepted:
    """Columns of accepted candidates, fit together: residuals (fit, held out), and a basis to project others off."""

    fit: Array
    held_out: Array
    basis: Array  # (N, r) orthonormal
    to_held_out: Array  # (M, r): what the basis is on the held-out side
    coefficients: Array


def accept(fit: Side, held_out: Side, chosen: Iterable[Pair]) -> Accepted:
    """Least squares of the chosen columns together; coefficients in their order."""
    pairs = list(chosen)
    if not pairs:
        empty = np.empty((len(fit.y), 0)), np.empty((len(held_out.y), 0))
        return Accepted(fit.y, held_out.y, *empty, np.empty(0))
    a = np.hstack([_whole(pair[0], len(fit.y)) for pair in pairs])
    a_held_out = np.hstack([_whole(pair[1], len(held_out.y)) for pair in pairs])
    scale = np.linalg.norm(a, axis=0)
    scale[scale == 0.0] = 1.0
    u, s, vt = np.linalg.svd(a / scale, full_matrices=False)
    keep = s > INDEPENDENT * s[0]
    back = (vt[keep].T / s[keep]) / scale[:, None]  # basis coordinates -> coefficients
    basis = u[:, keep]
    seen = basis.T @ fit.y
    to_held_out = a_held_out @ back
    return Accepted(fit.y - basis @ seen, held_out.y - to_held_out @ seen, basis, to_held_out, back @ seen)


def _whole(columns: Columns, length: int) -> Array:
    whole = np.zeros((length, columns.x.shape[1]))
    whole[columns.where] = columns.x
    return whole


def fit_gain(columns: Columns, accepted: Accepted) -> tuple[float, Array]:
    """Fall of the squared fit error by a candidate beside the accepted ones, and its coefficients (k,)."""
    inside = columns.dot(accepted.basis)  # (k, r)
    gram = columns.x.T @ columns.x
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0.0] = 1.0
    gram = (gram - inside @ inside.T) / np.outer(scale, scale)
    toward = columns.dot(accepted.fit) / scale
    values, vectors = np.linalg.eigh(gram)
    keep = values > INDEPENDENT**2
    along = vectors[:, keep].T @ toward
    coefficients = vectors[:, keep] @ (along / values[keep])
    return float(along @ (along / values[keep])), coefficients / scale


def look(candidate: Candidate, pair: Pair, accepted: Accepted, held_out: Side) -> Look:
    """What one candidate adds beside the accepted ones."""
    gain, c, fall = gain_of(pair, accepted, held_out)
    blocks = held_out.by_block(fall)
    p = p_value(blocks)
    if candidate.definition.sparse and p > 1e-4 and blocks.sum() > 0.0:
        predicted = pair[1].spread(c, len(held_out.y))
        p = min(p, shift_p_value(by_recording(predicted, held_out), by_recording(accepted.held_out, held_out)))
    return Look(candidate, c, gain, float(fall.sum()), p, blocks, held_out.by_joint(fall))


def by_recording(values: Array, side: Side) -> list[Array]:
    """Values (n * rows,) as (m, n) of each recording."""
    ends = np.cumsum([len(run.t) for run in side.runs])
    return np.split(values.reshape(-1, side.rows).T, ends[:-1])


def gain_of(pair: Pair, accepted: Accepted, held_out: Side) -> tuple[float, Array, Array]:
    """Fall of the squared fit error by columns beside the accepted ones, their coefficients (k,), fall of the held-out one row by row."""
    gain, c = fit_gain(pair[0], accepted)
    inside = pair[0].dot(accepted.basis).T @ c
    after = accepted.held_out - pair[1].spread(c, len(held_out.y)) + accepted.to_held_out @ inside
    return gain, c, accepted.held_out**2 - after**2


def best_shapes(
    library: Mapping[Candidate, Pair], accepted: Accepted, fit: Side, taken: set[EffectKey]
) -> list[Candidate]:
    """For every effect at every joint, the shape that fits the currents of its own joint best beside the accepted ones."""
    shapes: dict[EffectKey, list[Candidate]] = {}
    for candidate in library:
        if candidate.key not in taken:
            shapes.setdefault(candidate.key, []).append(candidate)
    return [
        max(several, key=lambda c: fit_gain(at_joint(library[c][0], c.joint, fit), accepted)[0])
        if len(several) > 1
        else several[0]
        for several in shapes.values()
    ]


def at_joint(columns: Columns, joint: int | None, side: Side) -> Columns:
    """The part of the columns that stands at one joint's rows; all of it for an effect of the whole arm."""
    if joint is None or columns.where == side.of(joint):
        return columns
    return Columns(columns.x[side.of(joint)], side.of(joint))


def shadows(held_out: Side, accepted: Accepted) -> Array:
    """(n,) squared held-out error of each joint's currents that what is accepted may have left for every coefficient of another effect."""
    explained = held_out.by_joint(held_out.y**2 - accepted.held_out**2)
    return SHADOW * explained + OF_CORRECTED * held_out.corrected


def matters(gain: Array, coefficients: int, shadow: Array, held_out: Side) -> bool:
    """Whether held-out gains (n,) of the joints are large against the noise, above the ``shadows`` (n,) of what is accepted.

    An effect with k coefficients is given the shadows k times: it has k ways to follow them.
    """
    above = np.maximum(gain - coefficients * shadow, 0.0)
    least = SHARE_OF_NOISE * max(1.0, coefficients / FOLLOWS) * held_out.rows
    return bool(min(above.sum(), gain.sum()) > least)


def round_of(
    library: Mapping[Candidate, Pair],
    accepted: Accepted,
    fit: Side,
    held_out: Side,
    taken: set[EffectKey],
    physical: Callable[[Candidate, Array], bool],
) -> list[Look]:
    """One round: every candidate looked at; those that may enter (and are ``physical``), best held-out gain first."""
    looks = [look(c, library[c], accepted, held_out) for c in best_shapes(library, accepted, fit, taken)]
    q = benjamini_hochberg(np.array([one.p for one in looks]))
    shadow = shadows(held_out, accepted)
    able = [
        one
        for one, q_one in zip(looks, q)
        if q_one < (SIGNIFICANT if one.held_out_gain < LARGE * held_out.rows else FEW_BLOCKS)
        and physical(one.candidate, one.coefficients)
        and matters(one.by_joint, len(one.coefficients), shadow, held_out)
    ]
    return sorted(able, key=lambda one: -one.held_out_gain)


def simplest(able: list[Look], held_out: Side) -> tuple[Look, list[Look]]:
    """Of the candidates that explain as much as the best one, the one with the fewest coefficients; and all that may be its equals.

    A candidate with more coefficients than another that explains the same is not an alternative but an excess. Equals are also those
    whose blocks do not tell them from the one that was taken: whether they look alike has still to be asked.
    """
    best, most = able[0].held_out_gain, len(able[0].coefficients)
    alike = [
        one
        for one in able
        if one.held_out_gain >= best - max(ALIKE * best * max(1, most - len(one.coefficients)), 0.02 * held_out.rows)
    ]
    fewest = min(len(one.coefficients) for one in alike)
    taken = next(one for one in alike if len(one.coefficients) == fewest)
    equals = [
        one
        for one in able
        if (one in alike and len(one.coefficients) == fewest)
        or (one.held_out_gain > NEAR * best and p_value(taken.blocks - one.blocks) > SURE)
    ]
    return taken, equals
