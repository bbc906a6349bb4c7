"""How many rows a counter lost at jumps of its angle, by the current of its joint.

A jump shows the number of lost rows well where the joint moves fast against its encoder's steps and the loss is short.
Otherwise the measured current does: it is compared with those predicted from the angle shifted by constant numbers of
rows. Between jumps the shift is constant; of all such paths, the one is chosen that the currents and the numbers of the
jumps make most likely (dynamic programming over the parts between jumps).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from diagnosis.residual.run import Run
from diagnosis.screening.lost_rows.lag_change import COLOURED
from diagnosis.screening.lost_rows.lag_path import PIECE

Index = NDArray[np.intp]

STEP = 0.004
"""s between shifts for which the current is predicted; between them the residual is interpolated."""
LEAST_STD = 1.0
"""Rows: least standard deviation of a shift by the current."""


def shifts_tried(most: int, dt: float) -> list[int]:
    """Numbers of rows from -``most`` to ``most`` for which the current is to be predicted."""
    step = max(1, round(STEP / dt))
    return list(range(-most, most + step, step))


def lost_by_current(
    runs: Mapping[int, Run], joint: int, jumps: Sequence[tuple[float, float]]
) -> list[tuple[int, float]]:
    """Rows lost at each jump beyond those already put back, and their std.

    runs   rows by which the angle of the joint (from 1) is delayed -> residual of the recording with it
    jumps  time (s) of each, and std of the number of rows that it shows
    """
    run = next(iter(runs.values()))
    fine = np.arange(min(runs), max(runs) + 1)
    errors = _errors(runs, joint, fine)
    edges = [0, *(round(time * run.per_second / PIECE) for time, _ in jumps), len(errors)]
    parts = np.stack([errors[a:b].sum(axis=0) for a, b in pairwise(np.clip(edges, 0, len(errors)).tolist())])
    instruments = float(np.mean(run.instruments[:, joint - 1] ** 2))
    parts /= (float(np.median(errors.min(axis=1))) / PIECE + instruments) * COLOURED
    path = _cheapest(parts, [std for _, std in jumps])
    stds = [_spread(part) for part in parts]
    return [
        (int(path[k + 1] - path[k]), min(std, float(np.hypot(stds[k], stds[k + 1]))))
        for k, (_, std) in enumerate(jumps)
    ]


def _errors(runs: Mapping[int, Run], joint: int, fine: Index) -> Array:
    """(p, K) A2: squared residual of a joint in every piece by shift, interpolated between the shifts predicted.

    The mean of each piece is subtracted, so that a load which the model lacks does not look like a shift.
    """
    tried = sorted(runs)
    values = np.stack([runs[rows].residual[:, joint - 1] for rows in tried])
    above = np.clip(np.searchsorted(tried, fine), 1, len(tried) - 1)
    low, high = np.take(tried, above - 1), np.take(tried, above)
    share = ((fine - low) / (high - low))[:, None]
    residual = (1.0 - share) * values[above - 1] + share * values[above]
    pieces = [residual[:, a : a + PIECE] for a in range(0, residual.shape[1] - PIECE + 1, PIECE)]
    return np.stack([PIECE * np.var(piece, axis=1) for piece in pieces])


def _cheapest(parts: Array, stds: Sequence[float]) -> Index:
    """(s,) index of the shift in every part, whose errors (s, K) and changes, each with its std, cost least."""
    shifts = np.arange(parts.shape[1])
    best, came_from = parts[0], []
    for part, std in zip(parts[1:], stds):
        costs = best + (shifts[:, None] - shifts) ** 2 / (2.0 * std**2)
        came_from.append(np.argmin(costs, axis=1))
        best = costs.min(axis=1) + part
    path = [int(np.argmin(best))]
    for of_part in reversed(came_from):
        path.append(int(of_part[path[-1]]))
    return np.array(path[::-1], dtype=np.intp)


def _spread(errors: Array) -> float:
    """Rows: std of the shift of a part, by its errors (K,); at least LEAST_STD."""
    likely = np.exp(-(errors - errors.min()) / 2.0)
    rows = np.arange(len(errors)) - int(np.argmin(errors))
    return max(float(np.sqrt(np.sum(likely * rows**2) / np.sum(likely))), LEAST_STD)
