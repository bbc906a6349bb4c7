"""What the procedure of the table states of names that it was not fitted to: every case judged by all others.

Names of one case share its recordings, so a case is left out as a whole. No split is drawn: the figures have no chance
but that of the cases.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tests.confidence.bank import Name
from tests.confidence.fit import SUREST, fitted, stated

PRINTED_AS_98 = 0.975
COUNTED = 100
"""Names that must have been given 98 %, of which 98 of 100 were right."""
LEAST = 25
"""Names of which a share is counted: the standard deviation of a share of fewer may be above 0.1."""
Array = np.ndarray


def cross_validated(names: Sequence[Name]) -> tuple[Array, float]:
    """(n,) stated of each name by the table of all other cases, and the most that any of these tables may state.

    1.0 where names that were then given 98 % confirm it; SUREST otherwise.
    """
    confidence = by_other_cases(names)
    right, foreign = np.array([(name.right, name.suite != "puma") for name in names]).T
    return (confidence, 1.0) if confirmed(confidence, right, foreign) else (np.minimum(confidence, SUREST), SUREST)


def confirmed(confidence: Array, right: Array, foreign: Array) -> bool:
    """Whether of the names of foreign arms that were given 98 % there are 100, and 98 of 100 were right; and of all.

    confidence, right, foreign: (n,). The Puma alone confirms nothing: it is the arm that all was developed on.
    """
    said = confidence >= PRINTED_AS_98
    return all(some.sum() >= COUNTED and right[some].sum() >= 0.98 * some.sum() for some in (said, said & foreign))


def by_other_cases(names: Sequence[Name]) -> Array:
    """(n,) stated of each name by the table of all other cases."""
    confidence = np.empty(len(names))
    for case in {name.key for name in names}:
        table = fitted([name for name in names if name.key != case])
        for at, name in enumerate(names):
            if name.key == case:
                confidence[at] = stated(table, name)
    return confidence


def reliability(confidence: Array, right: Array) -> list[tuple[float, int, int]]:
    """(mean stated confidence, names, right names) of groups of ``LEAST`` names or more, lowest confidence first.

    confidence, right: (n,). Names of equal confidence are in one group; fewer than ``LEAST`` at the upper end join the
    group below.
    """
    order = np.argsort(confidence, kind="stable")
    begins = [0]
    for at in range(1, len(order)):
        if at - begins[-1] >= LEAST and confidence[order[at]] > confidence[order[at - 1]]:
            begins.append(at)
    if len(begins) > 1 and len(order) - begins[-1] < LEAST:
        begins.pop()
    groups = np.split(order, begins[1:])
    return [(float(confidence[group].mean()), len(group), int(right[group].sum())) for group in groups]


def chances(confidence: Array, right: Array) -> tuple[float, float]:
    """Probabilities of so few and of so many right names, if each is right with its stated confidence.

    confidence, right: (n,). The number of right names has the Poisson binomial distribution.
    """
    distribution = np.ones(1)
    for p in confidence:
        distribution = np.convolve(distribution, (1.0 - p, p))
    hits = int(right.sum())
    return float(distribution[: hits + 1].sum()), float(distribution[hits:].sum())
