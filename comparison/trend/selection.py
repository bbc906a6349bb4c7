"""Which quantities moved, and in which shapes: forward selection with false discoveries controlled.

For each quantity every term is tested; the smallest p-value times the number of tests (Bonferroni) is that of "it
moved". Over all quantities these are corrected as Benjamini and Hochberg do. Further terms of a quantity that moved are
held to the level at which quantities were accepted (Benjamini & Bogomolov, JRSS B 76 (2014) 297). The scatter of
quantities of one kind beyond their deviations is estimated from all of them (``comparison.significance``), anew after
each round, as those that move are explained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from comparison.change import SIGNIFICANT
from comparison.significance import FEWEST, common_scatter
from comparison.trend.history import History
from comparison.trend.onsets import Onsets, onsets_of
from comparison.trend.terms import Fit, Scatter, Term, between_of, candidates, fit, tests

MOST_TERMS = 4
"""Of one history: more are no trend but scatter."""
FEW = Scatter(1.0, 2.0)
"""Known of a kind with too few quantities to estimate it: that the deviations are right, as if from two residuals."""


@dataclass(frozen=True)
class Moved:
    """One history, what it is made of, and how surely it moved.

    onsets        the same fit with every onset that its drifts may have
    p, corrected  of "it moved", corrected for the number of quantities
    freedom       degrees of freedom of the variance between results
    p_shape       that results scatter so much about the fit, as far as others of their kind do about theirs
    """

    history: History
    fit: Fit
    onsets: Onsets
    p: float
    corrected: float
    freedom: float
    p_shape: float


def select(histories: Sequence[History]) -> list[Moved]:
    """Every history with the terms that it needs; none: it did not move."""
    tried = [candidates(one) for one in histories]
    fits = [fit(one, ()) for one in histories]
    while True:
        scatters = _known(histories, fits)
        # Tests start from the variance between results of the whole kind: a history's own would contain what moved.
        usual = [between_of(h, fitted, Scatter(k.value, np.inf)) for h, fitted, k in zip(histories, fits, scatters)]
        fits = [fit(h, fitted.terms, between) for h, fitted, between in zip(histories, fits, usual)]
        still = [fit(h, (), between) for h, between in zip(histories, usual)]
        first = np.array([_smallest(h, f, t, k.freedom)[0] for h, f, t, k in zip(histories, still, tried, scatters)])
        corrected = np.asarray(stats.false_discovery_control(first)) if len(first) else first
        moved = corrected <= SIGNIFICANT
        level = SIGNIFICANT * float(moved.mean()) if len(first) else 0.0
        added = False
        for k, history in enumerate(histories):
            if moved[k] and len(fits[k].terms) < MOST_TERMS and fits[k].freedom > 0:
                terms = _extended(history, fits[k], tried[k], scatters[k].freedom, level)
                added = added or set(terms) != set(fits[k].terms)
                fits[k] = fit(history, terms, fits[k].between)
        if not added:
            break
    fits = [fitted if moves else alone for fitted, alone, moves in zip(fits, still, moved)]
    return [_moved(*one) for one in zip(histories, fits, first, corrected, scatters)]


def _moved(history: History, fitted: Fit, p: float, corrected: float, known: Scatter) -> Moved:
    final = fit(history, fitted.terms, between_of(history, fitted, known))
    freedom = known.freedom + fitted.freedom
    p_shape = 1.0
    if final.freedom > 0:
        others = min(known.freedom, 1e6)
        p_shape = float(stats.f.sf(final.rest / final.freedom / known.value, final.freedom, others))
    return Moved(history, final, onsets_of(history, final, freedom), float(p), float(corrected), freedom, p_shape)


def _extended(history: History, fitted: Fit, tried: list[Term], freedom: float, level: float) -> tuple[Term, ...]:
    """The terms with one more, where one is significant: the first always is, others must reach ``level``."""
    p, term = _smallest(history, fitted, tried, freedom)
    if term is None or (fitted.terms and p > level):
        return fitted.terms
    terms = (*fitted.terms, term)
    for _ in range(MOST_TERMS):
        before = terms
        for one in before:
            others = fit(history, tuple(other for other in terms if other != one), fitted.between)
            _, best = _smallest(history, others, tried, freedom)
            terms = (*others.terms, best or one)
        if set(terms) == set(before):
            break
    return terms


def _smallest(history: History, fitted: Fit, tried: list[Term], freedom: float) -> tuple[float, Term | None]:
    """The smallest p-value of a term that may be added, corrected for their number, and the term."""
    free = [term for term in tried if term not in fitted.terms]
    if not free:
        return 1.0, None
    p, gain = tests(history, fitted, free, freedom)
    best = min(range(len(free)), key=lambda k: (p[k], -gain[k]))
    return min(1.0, float(p[best]) * len(free)), free[best]


def _known(histories: Sequence[History], fits: Sequence[Fit]) -> list[Scatter]:
    """What is known of the scatter of each history, from all of its kind with the terms found so far."""
    kinds = ["friction" if history.quantity.kind == "curve" else history.quantity.kind for history in histories]
    scatters = {}
    for kind in set(kinds):
        of_kind = [fitted for fitted, its in zip(fits, kinds) if its == kind and fitted.freedom > 0]
        if len(of_kind) < FEWEST:
            scatters[kind] = FEW
        else:
            freedom = np.array([one.freedom for one in of_kind], float)
            scatters[kind] = Scatter(*common_scatter(np.array([one.rest for one in of_kind]) / freedom, freedom))
    return [scatters[kind] for kind in kinds]
