"""The best one or two effects of a joint by its fitted rows, to first order: which of all are worth a trial."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.pairs import distinct_pairs
from diagnosis.measurements.currents.replacement.trial import residual_energy
from diagnosis.measurements.currents.state import State
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns
from diagnosis.selection.regression import at_joint, best_of_each, fit_gain

if TYPE_CHECKING:
    from diagnosis.measurements.currents.model import Currents

BEAM = 3
"""Sets that are fitted to all joints and evaluated exactly, of those that leave least of the fitted rows of a joint."""


def best_sets(without: State, joint: int, most: int, enough: float) -> Iterator[tuple[Candidate, ...]]:
    """The best sets of one or two effects of a joint, of so many coefficients at most, that leave ``enough`` of it."""
    model, fitted, fit = without.model, without.fitted, without.data.fit
    of_joint = [c for c in model.library if c.joint == joint and not c.unit_amplitude]
    best = best_of_each(of_joint, model.library.at_own_joint, fitted, model.taken(without))
    own = {c: at_joint(model.columns(c).fit, joint, fit).x for c in best}
    found: list[tuple[float, tuple[Candidate, ...]]] = []
    for some in (*((one,) for one in best), *distinct_pairs(best)):
        if (coefficients := coefficients_of(some, model)) <= most:
            x = Columns(np.hstack([own[c] for c in some]), fit.of(joint))
            left = residual_energy(without, joint) - fit_gain(x, fitted)[0]
            if left < enough:
                # of equals, those with the fewest
                found.append((left + coefficients * LIMITS.tie_floor * fit.rows, some))
    return (some for _, some in sorted(found, key=lambda one: one[0])[:BEAM])


def coefficients_of(some: Sequence[Candidate], model: Currents) -> int:
    """Number of their columns and searched parameters."""
    return sum(model.columns(c).fit.x.shape[1] + len(c.searched()) for c in some)
