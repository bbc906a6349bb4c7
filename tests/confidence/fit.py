"""The table of confidence, fitted to names of the bank: a score of the evidence, and what ranges of it state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize

from diagnosis.confidence import beside_unexplained, counted, features
from tests.confidence.bank import Name

PENALTY = 0.05
"""Of squared weights per name: with few names, none of them may decide."""
SIGNS = (1, -1, 1, -1, -1)
"""Of the weights: more gain and sureness speak for a name; more left, more names, more unexplained against it.

A small bank must not turn that round.
"""
LEAST = 25
"""Names of which a share is counted: the standard deviation of a share of fewer may be above 0.1."""
FEW = 0.5
"""Stated of names beside what is unexplained while there are fewer than ``LEAST`` of them: too few to count."""
SUREST, COUNTED = 0.97, 100
"""98 % is stated only of a range with so many names of which 98 of 100 were right; fewer names state less."""
Array = np.ndarray


def fitted(names: Sequence[Name], most: float = 1.0) -> dict[str, Any]:
    """Weights, constant, steps and the count of names beside what is unexplained of ``diagnosis/confidence.json``.

    most: the largest confidence that a step may state
    """
    x = np.array([features(name.support) for name in names])
    right = np.array([name.right for name in names], float)
    constant, weights = _logistic(x, right)
    beside = np.array([beside_unexplained(name.support) for name in names])
    order = np.argsort(score := constant + x @ weights, kind="stable")
    order = order[~beside[order]]
    count, hits = int(beside.sum()), int(right[beside].sum())
    return {
        "constant": round(constant, 4),
        "weights": [round(float(weight), 4) for weight in weights],
        "steps": steps(score[order], right[order], most),
        "beside": {"confidence": level(count, hits, most) if count >= LEAST else FEW, "names": count, "right": hits},
    }


def _logistic(x: Array, right: Array) -> tuple[float, Array]:
    """Constant and weights of the largest likelihood, penalised in units of each feature's spread, with known signs."""
    spread = np.maximum(x.std(axis=0), 1e-9)
    design = np.column_stack([np.ones(len(x)), x / spread])

    def cost(at: Array) -> tuple[float, Array]:
        odds = design @ at
        p = 1.0 / (1.0 + np.exp(-odds))
        penalty = PENALTY * len(x)
        value = np.sum(np.logaddexp(0.0, odds) - right * odds) + 0.5 * penalty * np.sum(at[1:] ** 2)
        return float(value), design.T @ (p - right) + penalty * np.append(0.0, at[1:])

    bounds = [(None, None), *((0.0, None) if sign > 0 else (None, 0.0) for sign in SIGNS)]
    at = minimize(cost, np.zeros(design.shape[1]), jac=True, method="L-BFGS-B", bounds=bounds).x
    return float(at[0]), at[1:] / spread


def steps(score: Array, right: Array, most: float = 1.0) -> list[dict[str, float]]:
    """Ranges of the score, lowest first, each with its names, how many were right, and what it states.

    score, right: (n,), the score rising. Neighbours are pooled until what is stated rises from step to step, which a
    share of right names alone does not do: 35 of 36 state more than 8 of 8.
    """
    pooled: list[tuple[float, int, int]] = []
    for group in np.array_split(np.arange(len(score)), max(len(score) // LEAST, 1)):
        start, names, hits = float(score[group[0]]), len(group), int(right[group].sum())
        while pooled and level(*pooled[-1][1:], most) >= level(names, hits, most):
            start, below, hits_below = pooled.pop()
            names, hits = names + below, hits + hits_below
        pooled.append((start, names, hits))
    return [
        {"from": round(start, 4), "confidence": level(names, hits, most), "names": names, "right": hits}
        for start, names, hits in pooled
    ]


def level(names: int, right: float, most: float = 1.0) -> float:
    """The confidence that a count states: (right + 1) / (names + 2), Laplace's rule of succession, at most ``most``.

    Of fewer than ``COUNTED`` names, or less than 98 of 100 right, ``SUREST`` at most.
    """
    stated = round((right + 1) / (names + 2), 3)
    return min(stated, most if names >= COUNTED and right >= 0.98 * names else min(most, SUREST))


def levels(table: dict[str, Any]) -> list[float]:
    """All that a table states, lowest first."""
    return sorted({table["beside"]["confidence"], *(step["confidence"] for step in table["steps"])})


def stated(table: dict[str, Any], name: Name) -> float:
    """The confidence that a table states for a name."""
    return min(name.support.significance, counted(table, name.support))
