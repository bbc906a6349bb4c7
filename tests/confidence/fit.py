"""The table of confidence, fitted to one half of the bank's cases and judged on the other."""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression, minimize

from diagnosis.confidence import beside_unexplained, counted, features
from tests.confidence.bank import Name

PENALTY = 0.05
"""Of squared weights per name: with few names, none of them may decide."""
SIGNS = (1, -1, 1, -1, -1)
"""Of the weights: more gain and sureness speak for a name; more left, more names, more unexplained against it.

A small bank must not turn that round.
"""
LEAST = 8
"""Names per step of the table."""
FEW = 0.5
"""Stated of names beside what is unexplained while there are fewer than ``LEAST`` of them: too few to count."""
SUREST, COUNTED = 0.97, 100
"""98 % is stated only of a range with so many names of which 98 of 100 were right; fewer names state less."""
Array = np.ndarray


def halves(names: Sequence[Name]) -> tuple[list[Name], list[Name]]:
    """Names of one half of the cases, and of the other: by case, whatever the order of the file."""
    sides: tuple[list[Name], list[Name]] = ([], [])
    for name in names:
        sides[zlib.crc32(f"{name.suite} {name.seed} {name.case}".encode()) % 2].append(name)
    return sides


def fitted(names: Sequence[Name]) -> dict[str, Any]:
    """Weights, constant, steps and the count of names beside what is unexplained of ``diagnosis/confidence.json``."""
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
        "steps": _steps(score[order], right[order]),
        "beside": {"confidence": level(count, hits) if count >= LEAST else FEW, "names": count, "right": hits},
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


def _steps(score: Array, right: Array) -> list[dict[str, float]]:
    """Ranges of the score, lowest first, each with one share of right names; it rises from step to step."""
    groups = np.array_split(np.arange(len(score)), max(len(score) // LEAST, 1))
    counts = np.array([len(group) for group in groups], float)
    shares = np.array([right[group].mean() for group in groups])
    rising = isotonic_regression(shares, weights=counts).x
    steps = []
    for value in np.unique(rising):
        inside = np.concatenate([group for group, one in zip(groups, rising) if one == value])
        names, hits = len(inside), float(right[inside].sum())
        start = float(score[inside[0]])
        steps.append({"from": round(start, 4), "confidence": level(names, hits), "names": names, "right": int(hits)})
    return steps


def level(names: int, right: float) -> float:
    """The confidence that a count states: (right + 1) / (names + 2), Laplace's rule of succession.

    Of fewer than ``COUNTED`` names, or less than 98 of 100 right, ``SUREST`` at most.
    """
    stated = round((right + 1) / (names + 2), 3)
    return stated if names >= COUNTED and right >= 0.98 * names else min(stated, SUREST)


def stated(table: dict[str, Any], name: Name) -> float:
    """The confidence that a table states for a name."""
    return min(name.support.significance, counted(table, name.support))


def reliability(confidence: Array, right: Array, edges: Sequence[float]) -> list[tuple[float, float, int]]:
    """(mean stated confidence, share of right names, names) per range of the confidence that has any."""
    rows = []
    for low, high in itertools.pairwise(edges):
        inside = (confidence >= low) & (confidence < high)
        if inside.any():
            rows.append((float(confidence[inside].mean()), float(right[inside].mean()), int(inside.sum())))
    return rows
