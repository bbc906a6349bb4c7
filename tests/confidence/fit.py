"""The table of confidence, fitted to names of the bank: the logistic curve of a score of the evidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize

from diagnosis.confidence import counted, features
from tests.confidence.bank import Name

PENALTY = 0.05
"""Of squared weights per name: with few names, none of them may decide."""
SIGNS = (1, -1, 1, -1)
"""Of the weights: a larger gain and a parameter that is better determined speak for a name; a larger gain of another
cause and what is left at its joint speak against it. A small bank must not turn that round.
"""
SUREST = 0.97
"""The most that is stated before names of other cases confirm 98 %."""
Array = np.ndarray


def fitted(names: Sequence[Name], most: float = 1.0) -> dict[str, Any]:
    """Constant, weights and the most that is stated of any name: ``diagnosis/confidence.json``."""
    right = np.array([name.right for name in names], float)
    constant, weights = _logistic(np.array([features(name.support) for name in names]), right)
    return {"constant": round(constant, 4), "weights": [round(float(weight), 4) for weight in weights], "most": most}


def _logistic(x: Array, right: Array) -> tuple[float, Array]:
    """Constant and weights of the largest likelihood, penalised in units of each feature's spread, with known signs.

    One right and one wrong name of mean evidence are added: without weights that is Laplace's rule of succession.
    """
    mean, spread = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    design = np.column_stack([np.ones(len(x) + 2), np.vstack([x - mean, np.zeros((2, x.shape[1]))]) / spread])
    right = np.append(right, [0.0, 1.0])

    def cost(at: Array) -> tuple[float, Array]:
        odds = design @ at
        p = 1.0 / (1.0 + np.exp(-odds))
        penalty = PENALTY * len(x)
        value = np.sum(np.logaddexp(0.0, odds) - right * odds) + 0.5 * penalty * np.sum(at[1:] ** 2)
        return float(value), design.T @ (p - right) + penalty * np.append(0.0, at[1:])

    bounds = [(None, None), *((0.0, None) if sign > 0 else (None, 0.0) for sign in SIGNS)]
    at = minimize(cost, np.zeros(design.shape[1]), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = at[1:] / spread
    return float(at[0] - weights @ mean), weights


def stated(table: dict[str, Any], name: Name) -> float:
    """The confidence that a table states for a name."""
    return min(name.support.significance, counted(table, name.support))
