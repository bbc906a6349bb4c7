"""Variables that a time-varying parameter depends on: shares of its variance, compared with chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.distortion.random_walk import STEP
from diagnosis.selection.binned_means import quantile_edges

BINS = 12
"""Bins of a variable, with equal numbers of values."""
DRAWS = 400
"""Permutations of blocks from which the shares by chance follow: p-values down to 1/400."""


@dataclass(frozen=True)
class Path:
    """The parameter in one recording, at s instants.

    t, value, std       (s,) s; value of the parameter and its std
    seen                (s,) whether the residual at that instant depends on it
    against             variables (s,) by name
    score, information  (s,) of the deviation from the model, by the residual at that instant alone
    alike               rows that count as one (``Run.alike``)
    """

    name: str
    t: Array
    value: Array
    std: Array
    seen: NDArray[np.bool_]
    against: dict[str, Array]
    score: Array
    information: Array
    alike: float


@dataclass(frozen=True)
class Share:
    """Share of the variance of the parameter that a variable explains beyond chance.

    chance  share with the blocks of the variable permuted
    gain    fall of the weighted squared residual if the parameter is a function of the variable alone
    """

    against: str
    share: float
    chance: float
    p: float
    gain: float


def shares_of(paths: Sequence[Path], memory: float) -> tuple[Share, ...]:
    """Shares of all variables, compared with those of their permuted blocks.

    memory: s, time constant of the smoother; blocks are three times as long, at least 1 s.
    """
    rng = np.random.default_rng(1)
    value, weight = (
        np.concatenate(parts) for parts in ([p.value[p.seen] for p in paths], [p.std[p.seen] ** -2 for p in paths])
    )
    score, seen = (np.concatenate(parts) for parts in zip(*((p.score[p.seen], p.information[p.seen]) for p in paths)))
    length = max(1, round(max(1.0, 3 * memory) / STEP))
    blocks = np.array_split(np.arange(len(value)), max(1, len(value) // length))
    names, alike = set.intersection(*(set(p.against) for p in paths)), float(np.mean([p.alike for p in paths]))
    shares = []
    for name in paths[0].against:
        if name not in names:
            continue
        x = np.concatenate([p.against[name][p.seen] for p in paths])
        edges = quantile_edges(x, BINS) if name != "direction" else np.array([0.0])
        bins = np.digitize(x, edges)
        share = _explained(value, weight, bins)
        chance = np.array(
            [
                _explained(value, weight, bins[np.concatenate([blocks[k] for k in rng.permutation(len(blocks))])])
                for _ in range(DRAWS)
            ]
        )
        beyond = (share - chance.mean()) / max(1.0 - chance.mean(), 1e-9)
        p = (1 + int(np.sum(chance >= share))) / (DRAWS + 1)
        shares.append(Share(name, max(float(beyond), 0.0), float(chance.mean()), p, _binned(score, seen, bins, alike)))
    return tuple(sorted(shares, key=lambda one: -one.share))


def _binned(score: Array, seen: Array, bins: NDArray[np.intp], alike: float) -> float:
    """Fall of the weighted squared residual by one value per bin, beyond that by one value and by chance."""
    total, information = np.bincount(bins, weights=score), np.bincount(bins, weights=seen)
    there = information > 0
    return float(
        np.sum(total[there] ** 2 / information[there]) - total.sum() ** 2 / information.sum() - there.sum() * alike
    )


def _explained(value: Array, weight: Array, bins: NDArray[np.intp]) -> float:
    """Share of the weighted variance of ``value`` that its means in the bins have."""
    total = np.bincount(bins, weights=weight)
    means = np.bincount(bins, weights=weight * value) / np.maximum(total, 1e-300)
    middle = np.average(value, weights=weight)
    return float(np.sum(total * (means - middle) ** 2) / max(np.sum(weight * (value - middle) ** 2), 1e-300))
