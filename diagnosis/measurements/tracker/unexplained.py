"""What no cause explains of the residual of tracked points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.cause import Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.measurements.tracker.model import LIMITS
from diagnosis.measurements.tracker.over_time import over_time
from diagnosis.measurements.tracker.points import Side
from diagnosis.measurements.tracker.regression import good
from diagnosis.selection.binned_means import predicted_by_bins, predicted_share

BINS = 24
"""Bins of a variable, with equal numbers of points."""
SHUFFLES = 200
"""Random signs of blocks that the chance of a share is counted by: p-values down to half of ``LIMITS.structure_p``."""


def unexplained_by_tracker(
    sides: Sequence[Side], residuals: Sequence[Array], without_zeros: Sequence[Array], level: float
) -> list[Structure]:
    """Structure in the residual of tracked points: waves, drifts, and the variable that predicts most of it.

    Of a residual far above the noise that no variable predicts, the size. Empty where the residual is noise.

    residuals (N, 3) m of each side; without_zeros: the same without what errors of the encoders' zeros explain, in
    which waves and drifts are searched for; level m: std of a coordinate that the points leave undetermined.
    """
    of_time = (over_time(side, residual, level) for side, residual in zip(reversed(sides), reversed(without_zeros)))
    times = next(filter(None, of_time), [])
    return times or _against(sides, residuals, level)


def _against(sides: Sequence[Side], residuals: Sequence[Array], level: float) -> list[Structure]:
    """The variable that predicts most of the held-out residual."""
    seen = [good(residual) for residual in residuals]
    fit, held_out = (residual[keep] for residual, keep in zip(residuals, seen))
    if np.sqrt(np.mean(held_out**2)) < LIMITS.structure_noise * level:
        return []
    best: Structure | None = None
    generator = np.random.default_rng(0)
    block = np.unique(sides[1].block[seen[1]], return_inverse=True)[1]
    for (name, x_fit), (_, x) in zip(*(_variables(side, keep) for side, keep in zip(sides, seen))):
        predicted = predicted_by_bins(x_fit, fit, x, BINS)
        share = predicted_share(held_out, predicted)
        if share > LIMITS.structure_share and (best is None or share > best.share):
            inner = np.bincount(block, weights=np.sum(held_out * predicted, axis=1))
            signs = generator.choice([-1.0, 1.0], size=(SHUFFLES, len(inner)))
            if np.mean(signs @ inner >= inner.sum()) < LIMITS.structure_p:
                best = Structure(Signal.TRACKER, None, name, share)
    ratio = float(np.sqrt(np.mean(held_out**2))) / level
    if best is None and ratio > LIMITS.far_above_noise:
        best = Structure(Signal.TRACKER, None, NO_VARIABLE, 0.0, f"{ratio:.1f} times the noise")
    return [best] if best else []


def _variables(side: Side, keep: NDArray[np.bool_]) -> list[tuple[str, Array]]:
    variables = [("time", side.t[keep])]
    for j in range(side.q.shape[1]):
        variables += [(f"position of joint {j + 1}", side.q[keep, j]), (f"velocity of joint {j + 1}", side.v[keep, j])]
        variables += [(f"load torque of joint {j + 1}", side.load[keep, j])]
        variables += [(f"motor angle of joint {j + 1}", np.mod(side.motor[keep, j], 2 * np.pi))]
    return variables
