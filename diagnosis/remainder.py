"""What is left after all causes, and what it depends on.

For every joint and every variable that a cause could hang on, the residual is averaged in bins of the variable on the fit recordings; the share
of the held-out residual that those averages predict is compared with what they predict when whole blocks change sign at random.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm
from diagnosis.library import Side

Array = NDArray[np.float64]

BINS = 24
SHARE = 0.1
"""Of the residual's variance: less is not worth a sentence."""
ROUGH = 1.3
"""Times the noise: a residual below it is noise as far as the noise is known."""


@dataclass(frozen=True)
class Structure:
    """``share`` of the variance of a joint's held-out residual current that is predictable from ``against``."""

    signal: str
    joint: int
    against: str
    share: float


def variables(side: Side, arm: Arm, joint: int) -> Iterator[tuple[str, Array]]:
    """Name and values (rows,) of everything that a residual of this joint is held against."""

    def gathered(name: str) -> Array:
        return np.concatenate([getattr(run, name)[:, joint - 1] for run in side.runs])

    yield "time", np.concatenate([run.t for run in side.runs])
    yield "position", gathered("q")
    yield "motor angle", np.mod(gathered("q") * arm.joints[joint - 1].ratio, 2 * np.pi)
    yield "velocity", gathered("v")
    yield "acceleration", gathered("a")
    yield "load torque", gathered("rigid")
    yield "current", gathered("current")
    for other in range(1, len(arm) + 1):
        if other != joint:
            yield f"position of joint {other}", np.concatenate([run.q[:, other - 1] for run in side.runs])
            yield f"velocity of joint {other}", np.concatenate([run.v[:, other - 1] for run in side.runs])


def structure_left(fit: Side, held_out: Side, left: tuple[Array, Array], arm: Arm, seed: int = 0) -> list[Structure]:
    """For each joint whose residual is rougher than noise, the variable that predicts most of it, if any predicts more than chance.

    ``left``: whitened residuals (fit, held out) after all causes. The null is made of sign changes of whole blocks (200 draws).
    """
    rng = np.random.default_rng(seed)
    found = []
    for joint in range(1, len(arm) + 1):
        y_fit, y = left[0][fit.of(joint)], left[1][held_out.of(joint)]
        if np.sqrt(np.mean(y**2)) < ROUGH:
            continue
        best: Structure | None = None
        for (name, x_fit), (_, x) in zip(variables(fit, arm, joint), variables(held_out, arm, joint)):
            edges = np.unique(np.quantile(x_fit, np.linspace(0, 1, BINS + 1)[1:-1]))
            bin_fit, bin_here = np.digitize(x_fit, edges), np.digitize(x, edges)
            predicted = _averages(y_fit, bin_fit, len(edges) + 1)[bin_here]
            share = 1.0 - float(np.sum((y - predicted) ** 2) / np.sum(y**2))
            if share > SHARE and share > (best.share if best else 0.0):
                blocks = held_out.block[held_out.of(joint)]
                inner = np.bincount(blocks, weights=y * predicted)
                signs = rng.choice([-1.0, 1.0], size=(200, len(inner)))
                if np.mean(signs @ inner >= inner.sum()) < 0.01:
                    best = Structure("current", joint, name, share)
        if best:
            found.append(best)
    return found


def _averages(values: Array, bins: NDArray[np.intp], count: int) -> Array:
    total, number = np.bincount(bins, weights=values, minlength=count), np.bincount(bins, minlength=count)
    averages: Array = total / np.maximum(number, 1)
    return averages
