"""What the procedure of the table states of names that it was not fitted to: every case judged by all others.

Names of one case share its recordings, so a case is left out as a whole. No split is drawn: the figures have no chance
but that of the cases.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tests.confidence.bank import Name
from tests.confidence.fit import COUNTED, LEAST, SUREST, fitted, stated

PRINTED_AS_98 = 0.975
APART = 2.0 / LEAST
"""Of levels that are judged one by one. Left out, a right name lowers the level of its step by up to 1 / LEAST, and a
wrong one raises it: of nearer levels, the lower would get the right names, and the higher the wrong ones."""
Array = np.ndarray


def cross_validated(names: Sequence[Name]) -> tuple[Array, float]:
    """(n,) stated of each name by the table of all other cases, and the most that any of these tables may state.

    1.0 where names that were then given 98 % confirm it; SUREST otherwise.
    """
    confidence = by_other_cases(names, 1.0)
    right, foreign = np.array([(name.right, name.suite != "puma") for name in names]).T
    return (confidence, 1.0) if confirmed(confidence, right, foreign) else (by_other_cases(names, SUREST), SUREST)


def confirmed(confidence: Array, right: Array, foreign: Array) -> bool:
    """Whether of the names of foreign arms that were given 98 % there are 100, and 98 of 100 were right; and of all.

    confidence, right, foreign: (n,). The Puma alone confirms nothing: it is the arm that all was developed on.
    """
    said = confidence >= PRINTED_AS_98
    return all(some.sum() >= COUNTED and right[some].sum() >= 0.98 * some.sum() for some in (said, said & foreign))


def by_other_cases(names: Sequence[Name], most: float) -> Array:
    """(n,) stated of each name by the table of all other cases, of which no step may state more than ``most``."""
    confidence = np.empty(len(names))
    for case in {name.key for name in names}:
        table = fitted([name for name in names if name.key != case], most)
        for at, name in enumerate(names):
            if name.key == case:
                confidence[at] = stated(table, name)
    return confidence


def reliability(confidence: Array, right: Array, levels: Sequence[float]) -> list[tuple[float, int, int]]:
    """(mean stated confidence, names, right names) of the names nearest to each level of a table that has any.

    confidence, right: (n,); levels: rising. Levels nearer than ``APART`` to each other are counted together.
    """
    begins = np.append(True, np.diff(levels) >= APART)
    nearest = np.cumsum(begins)[np.abs(np.subtract.outer(confidence, levels)).argmin(axis=1)]
    rows = []
    for at in np.unique(nearest):
        inside = nearest == at
        rows.append((float(confidence[inside].mean()), int(inside.sum()), int(right[inside].sum())))
    return rows
