"""Delays of the currents that are too long for their change of a current to be of the first order."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.design_matrix import Library
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.regression import Fitted, fit_gain

FIRST_ORDER = 2e-3
"""s: a delay whose change of a current at COMPARE_BAND is of the first order, 2 pi 20 Hz times it a quarter."""
STEPS = 6
"""Values at most by which the value of a long delay is approached."""


def long_delays(library: Library, fitted: Fitted, taken: Set[EffectKey]) -> list[Candidate]:
    """Delays that are not ``taken``, each about the value that it has; added to the library.

    Approached from the first-order estimate: each value is about the one before. Without a delay in the data, but much
    else, the values do not settle.
    """
    found = []
    for candidate in [c for c in library if c.definition.delay is not None and not c.about]:
        for _ in range(STEPS if candidate.key not in taken else 0):
            (delay,) = fit_gain(library.where_shown(candidate), fitted)[1]
            if abs(delay - candidate.about) < FIRST_ORDER:
                found += [candidate] if candidate.about else []
                break
            candidate = replace(candidate, about=float(delay))
            library.add(candidate)
    return found
