"""The table of confidence, fitted to names of the bank: the logistic curve of a score of the evidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from diagnosis.confidence import features, success_rate
from tests.confidence.bank import Name

PENALTY = 0.05
"""Of squared weights per name: with few names, none of them may decide."""
SIGNS = (1, -1, 1, -1)
"""Of the weights: a larger gain and a parameter that is better determined speak for a name; a larger gain of another
cause and what is left at its joint speak against it. A small bank must not turn that round.
"""
SUREST = 0.97
"""The most that is stated before names of other cases confirm 98 %."""
STEPS = 12
"""Of Newton's method; each doubles the digits."""
Array = np.ndarray


def fitted(names: Sequence[Name], most: float = 1.0) -> dict[str, Any]:
    """Constant, weights and the most that is stated of any name: ``diagnosis/confidence.json``."""
    right = np.array([name.right for name in names], float)
    constant, weights = logistic(np.array([features(name.support) for name in names]), right)
    return {"constant": round(constant, 4), "weights": [round(float(weight), 4) for weight in weights], "most": most}


def logistic(x: Array, right: Array) -> tuple[float, Array]:
    """Constant and weights of the largest likelihood, penalised in units of each feature's spread, with known signs.

    One right and one wrong name of mean evidence are added: without weights that is Laplace's rule of succession. A
    feature whose weight has the other sign is left out, the furthest first.
    """
    mean, spread = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    evidence = np.vstack([x - mean, np.zeros((2, x.shape[1]))]) / spread
    kept = list(range(x.shape[1]))
    while True:
        constant, own = _newton(evidence[:, kept], np.append(right, [0.0, 1.0]))
        signed = own * np.array(SIGNS)[kept]
        if (signed >= 0.0).all():
            break
        del kept[int(np.argmin(signed))]
    weights = np.zeros(x.shape[1])
    weights[kept] = own / spread[kept]
    return float(constant - weights @ mean), weights


def _newton(evidence: Array, right: Array) -> tuple[float, Array]:
    """Constant and weights of the penalised regression of ``right`` (n,) on evidence (n, k), by Newton's method."""
    design = np.column_stack([np.ones(len(evidence)), evidence])
    penalty = PENALTY * len(evidence) * np.append(0.0, np.ones(evidence.shape[1]))
    at = np.zeros(design.shape[1])
    for _ in range(STEPS):
        p = 1.0 / (1.0 + np.exp(-design @ at))
        hessian = (design.T * (p * (1.0 - p))) @ design + np.diag(penalty)
        at -= np.linalg.solve(hessian, design.T @ (p - right) + penalty * at)
    return float(at[0]), at[1:]


def stated(table: dict[str, Any], name: Name) -> float:
    """The confidence that a table states for a name."""
    return min(name.support.significance, success_rate(table, name.support))
