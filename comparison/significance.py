"""From the estimates of two sides to changes with deviations and corrected significance.

One recording per side: change over the root of the sum of variances, judged by Student's t with the degrees of freedom
of Welch and Satterthwaite, because each variance rests on a dozen blocks of time or more.

Groups: recordings of one side also differ by what their own deviations do not show (temperature, an error of the model
that another motion shows otherwise). This scatter is added as in a random-effects meta-analysis (DerSimonian & Laird,
Controlled Clinical Trials 7 (1986) 177). From two or three recordings it would be poorly known; therefore Cochran's Q
of a quantity is moderated by that of all quantities of its kind (Smyth, Stat. Appl. Genet. Mol. Biol. 3 (2004) 3), and
t has the degrees of freedom that follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special, stats

from arm_io.types import Array
from comparison.change import Change, Estimate, Quantity, number

FEWEST = 5
"""Quantities of one kind from which the common scatter is estimated."""


@dataclass(frozen=True)
class Pooled:
    """One side: weighted mean, std (two hold 95 %), raw std and its degrees of freedom, each (r,)."""

    mean: Array
    std: Array
    raw: Array
    freedom: Array


def changes(
    quantities: Sequence[Quantity],
    before: Sequence[Estimate],
    after: Sequence[Estimate],
    shared: Array | None = None,
) -> list[Change]:
    """The change of every quantity; those with a reason ``why`` are kept out of the tests.

    shared  (r,) std of the change by errors that both sides have alike, as motions differ in what they excite
    """
    scatter, freedom = _scatter([q.kind for q in quantities], [before, after])
    sides = [_pooled(side, scatter) for side in (before, after)]
    extra = np.zeros(len(quantities)) if shared is None else shared
    raw = np.sqrt(sides[0].raw ** 2 + sides[1].raw ** 2 + extra**2)
    std = np.sqrt(sides[0].std ** 2 + sides[1].std ** 2 + extra**2)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = (sides[1].mean - sides[0].mean) / raw
        welch = (sides[0].raw ** 2 + sides[1].raw ** 2) ** 2 / sum(s.raw**4 / s.freedom for s in sides)
        p = np.asarray(2 * stats.t.sf(np.abs(t), np.where(scatter > 1, np.minimum(welch, freedom), welch)))
    tested = np.array([not q.why for q in quantities], bool) & np.isfinite(p)
    corrected = _corrected(quantities, np.where(tested, p, np.nan))
    grouped = len(before) + len(after) > 2
    return [
        Change(
            quantity=quantity
            if quantity.why or tested[k]
            else quantity.not_comparable("one side does not determine it"),
            before=number(sides[0].mean[k]),
            after=number(sides[1].mean[k]),
            std_before=number(sides[0].std[k]),
            std_after=number(sides[1].std[k]),
            std=number(std[k]),
            p=number(p[k]) if tested[k] else None,
            corrected=number(corrected[k]),
            scatter=number(np.sqrt(scatter[k])) if grouped else None,
        )
        for k, quantity in enumerate(quantities)
    ]


def _corrected(quantities: Sequence[Quantity], p: Array) -> Array:
    """(r,) p-values (NaN: not tested) corrected for false discoveries, as Benjamini & Hochberg do.

    A friction curve counts once, whatever its number of points, by Simes' combination of them: or else a curve that
    changed everywhere would let false discoveries through elsewhere, at the usual share of its many true ones. A point
    of a curve is no surer than its curve (Benjamini & Bogomolov, JRSS B 76 (2014) 297).
    """
    curve = np.array([(q.joint or 0) if q.kind == "curve" else 0 for q in quantities])
    within = p.copy()
    families = [np.flatnonzero((curve == joint) & np.isfinite(p)) for joint in np.unique(curve[curve > 0])]
    families = [family for family in families if len(family)]
    for family in families:
        within[family] = stats.false_discovery_control(p[family])
    single = np.flatnonzero((curve == 0) & np.isfinite(p))
    together = np.array([*p[single], *(within[family].min() for family in families)])
    corrected = np.full(len(p), np.nan)
    if len(together):
        adjusted = stats.false_discovery_control(together)
        corrected[single] = adjusted[: len(single)]
        for family, least in zip(families, adjusted[len(single) :]):
            corrected[family] = np.maximum(within[family], least)
    return corrected


def _weights(side: Sequence[Estimate]) -> tuple[Array, Array]:
    """values and inverse variances (n, r); weight 0 where a recording says nothing."""
    values = np.array([one.values for one in side])
    raw = np.array([one.raw for one in side])
    there = np.isfinite(values) & np.isfinite(raw) & (raw > 0)
    return np.where(there, values, 0.0), np.where(there, 1 / np.where(there, raw, 1.0) ** 2, 0.0)


def _cochran(side: Sequence[Estimate]) -> tuple[Array, Array]:
    """(r,) Cochran's Q of one side, and its degrees of freedom: recordings less one."""
    values, weight = _weights(side)
    total = np.maximum(weight.sum(axis=0), 1e-300)
    mean = (weight * values).sum(axis=0) / total
    return (weight * (values - mean) ** 2).sum(axis=0), np.maximum((weight > 0).sum(axis=0) - 1, 0)


def _between(weight: Array, scatter: Array) -> Array:
    """(r,) variance between recordings (n, r) such that Q would be ``scatter`` (r,) times its degrees of freedom."""
    total = np.maximum(weight.sum(axis=0), 1e-300)
    spare = total - (weight**2).sum(axis=0) / total
    degrees = np.maximum((weight > 0).sum(axis=0) - 1, 0)
    # a single recording on one side is taken to scatter like those on the other
    return np.where(degrees > 0, degrees / np.maximum(spare, 1e-300), 1 / total) * np.maximum(scatter - 1, 0.0)


def _pooled(side: Sequence[Estimate], scatter: Array) -> Pooled:
    """The weighted mean of a side, every recording with its own variance and that between recordings."""
    values, weight = _weights(side)
    between = _between(weight, scatter)
    seen = weight > 0
    variance = np.where(seen, 1 / np.where(seen, weight, 1.0) + between, np.inf)
    share = 1 / variance
    total = share.sum(axis=0)
    has_freedom = total > 0
    share = share / np.where(has_freedom, total, 1.0)
    part = share**2 * np.where(seen, variance, 0.0)
    widened = np.array([np.where(s, one.std, 1.0) / np.where(s, one.raw, 1.0) for s, one in zip(seen, side)])
    freedom = np.array([one.freedom for one in side])[:, None]
    sums = (part.sum(axis=0), (part * widened**2).sum(axis=0), (part**2 / freedom).sum(axis=0))
    raw, std, fourth = (np.where(has_freedom, each, np.nan) for each in sums)
    mean = np.where(has_freedom, (share * values).sum(axis=0), np.nan)
    return Pooled(mean, np.sqrt(std), np.sqrt(raw), raw**2 / fourth)


def _scatter(kinds: Sequence[str], sides: Sequence[Sequence[Estimate]]) -> tuple[Array, Array]:
    """(r,) Cochran's Q over its degrees of freedom, moderated within each kind, and the degrees of freedom after that.

    1 and infinity where no side has two recordings of a quantity.
    """
    q, freedom = np.sum([_cochran(side) for side in sides], axis=0)
    moderated, left = np.ones(len(kinds)), np.full(len(kinds), np.inf)
    # points of friction curves and friction parameters are taken to scatter alike
    groups = np.array(["friction" if kind == "curve" else kind for kind in kinds])
    for kind in set(groups):
        mine = (groups == kind) & (freedom > 0)
        if mine.any():
            moderated[mine], left[mine] = moderate(q[mine] / freedom[mine], freedom[mine])
    return moderated, left


def moderate(ratio: Array, freedom: Array) -> tuple[Array, Array]:
    """(m,) variance ratios with ``freedom`` (m,) degrees each, shrunk towards their common value, and the new degrees.

    Fewer than FEWEST ratios are returned unchanged.
    """
    if len(ratio) < FEWEST:
        return ratio, freedom
    s0, d0 = common_scatter(ratio, freedom)
    if np.isinf(d0):
        return np.full_like(ratio, s0), np.full_like(freedom, np.inf)
    return (d0 * s0 + freedom * ratio) / (d0 + freedom), d0 + freedom


def common_scatter(ratio: Array, freedom: Array) -> tuple[float, float]:
    """The common value of (m,) variance ratios with ``freedom`` (m,) degrees each, and its own degrees of freedom.

    By the moments of log F (Smyth 2004, section 6.2); infinite degrees: they scatter no more than chance explains.
    """
    half = freedom / 2
    e = np.log(np.maximum(ratio, 1e-12)) - special.digamma(half) + np.log(half)
    excess = float(np.var(e, ddof=1) - np.mean(special.polygamma(1, half)))
    if excess <= 0:
        return float(np.mean(ratio)), np.inf
    # Trigamma falls from infinity to nothing: one solution.
    d0 = 2 * float(optimize.brentq(lambda x: float(special.polygamma(1, x)) - excess, 1e-6, 1e8))
    return float(np.exp(np.mean(e) + special.digamma(d0 / 2) - np.log(d0 / 2))), d0
