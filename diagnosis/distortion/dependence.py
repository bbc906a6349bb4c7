"""What the variation of a parameter varies with: shares of its variance, against what chance would explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.distortion.random_walk import STEP
from diagnosis.residual.run import ROWS_FOR_ONE

BINS = 12
DRAWS = 400


@dataclass(frozen=True)
class Path:
    """One recording: t (s,) s; value, std (s,) of the parameter; seen (s,): whether that instant shows it.

    Against: variables (s,) by name; score, information (s,): what the residual of that instant alone says of the
    deviation from the model.
    """

    name: str
    t: Array
    value: Array
    std: Array
    seen: NDArray[np.bool_]
    against: dict[str, Array]
    score: Array
    information: Array


@dataclass(frozen=True)
class Share:
    """Of the variance of the parameter, what a variable explains beyond chance.

    ``chance``: what it does with its blocks permuted; gain: fall of the weighed squared residual when the parameter is
    a function of the variable alone.
    """

    against: str
    share: float
    chance: float
    p: float
    gain: float


def shares_of(paths: Sequence[Path], memory: float) -> tuple[Share, ...]:
    """What every variable explains of the parameter's variance.

    Against its blocks (three memories long, at least 1 s) permuted.
    """
    rng = np.random.default_rng(1)
    value, weight = (
        np.concatenate(parts) for parts in ([p.value[p.seen] for p in paths], [p.std[p.seen] ** -2 for p in paths])
    )
    score, seen = (np.concatenate(parts) for parts in zip(*((p.score[p.seen], p.information[p.seen]) for p in paths)))
    length = max(1, round(max(1.0, 3 * memory) / STEP))
    blocks = np.array_split(np.arange(len(value)), max(1, len(value) // length))
    names = set.intersection(*(set(p.against) for p in paths))
    found = []
    for name in paths[0].against:
        if name not in names:
            continue
        x = np.concatenate([p.against[name][p.seen] for p in paths])
        edges = np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)[1:-1])) if name != "direction" else np.array([0.0])
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
        found.append(Share(name, max(float(beyond), 0.0), float(chance.mean()), p, _binned(score, seen, bins)))
    return tuple(sorted(found, key=lambda one: -one.share))


def _binned(score: Array, seen: Array, bins: NDArray[np.intp]) -> float:
    """Fall of the weighed squared residual by one value a bin.

    Beyond that by one value and by one more for every bin.
    """
    total, information = np.bincount(bins, weights=score), np.bincount(bins, weights=seen)
    there = information > 0
    return float(
        np.sum(total[there] ** 2 / information[there])
        - total.sum() ** 2 / information.sum()
        - there.sum() * ROWS_FOR_ONE
    )


def _explained(value: Array, weight: Array, bins: NDArray[np.intp]) -> float:
    """Share of the weighted variance of ``value`` that its means in the bins have."""
    total = np.bincount(bins, weights=weight)
    means = np.bincount(bins, weights=weight * value) / np.maximum(total, 1e-300)
    middle = np.average(value, weights=weight)
    return float(np.sum(total * (means - middle) ** 2) / max(np.sum(weight * (value - middle) ** 2), 1e-300))
