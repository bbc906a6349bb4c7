"""Points cut into blocks of neighbours, which are held out together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identification.kinematics.data.runs import Run
from identification.kinematics.models.chain import Index

BLOCKS = 50
"""Blocks per run."""


def split(runs: Sequence[Run]) -> tuple[list[Run], list[Run]]:
    """Every run in blocks of a fiftieth of its rows, every fifth block held out.

    Both halves keep all rows; the points of the other half are NaN.
    """
    kept, left = [], []
    for run in runs:
        many = len(run.t) >= 5 * BLOCKS
        block = np.arange(len(run.t)) * BLOCKS // max(len(run.t), 1) if many else np.arange(len(run.t))
        out = (block % 5 == 2)[:, None]
        kept.append(replace(run, xyz=np.where(out, np.nan, run.xyz)))
        left.append(replace(run, xyz=np.where(out, run.xyz, np.nan)))
    return kept, left


def blocks(runs: Sequence[Run], rows: Sequence[Index]) -> Index:
    """Block number of every point: a second each, or a fiftieth of a run where rows are few (poses, one row each).

    All targets of one pose are in one block.
    """
    numbers = [np.zeros(0, int)] * len(runs)
    offset = 0
    for source in dict.fromkeys(run.source for run in runs):
        of_source = [k for k, run in enumerate(runs) if run.source == source]
        seen = np.unique(np.concatenate([rows[k] for k in of_source]))
        t = runs[of_source[0]].t[seen]
        block = np.floor(t - t[0]).astype(int) if len(seen) else np.zeros(0, int)
        count = len(np.unique(block))
        if count < 8 or count > len(seen) / 3:
            block = np.arange(len(seen)) * min(BLOCKS, len(seen)) // max(len(seen), 1)
        for k in of_source:
            numbers[k] = block[np.searchsorted(seen, rows[k])] + offset
        offset += (int(block.max()) + 1) if len(block) else 0
    return np.concatenate(numbers)
