"""What each recording alone says of the causes between two encoders, and whether the recordings contradict each other.

A property of an arm is the same in every recording. A value that differs by more than its deviations belongs to the
recording, as the zero of an incremental encoder does, or the cause is not what the difference between the encoders is
made of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from arm_io.types import Array
from diagnosis.measurements.link_encoders.columns import LinkCandidate
from diagnosis.measurements.link_encoders.model import Chosen, LinkEncoders
from identification.selection import BLOCK_SECONDS
from identification.selection.cluster_covariance import cluster_covariance

CHANCE = 1e-3
"""Probability of differences that large by chance, over all causes, below which recordings contradict each other."""
SAME = 0.05
"""Relative difference of values that is no contradiction: first-order columns are not better."""


@dataclass(frozen=True)
class Alone:
    """Coefficients (c,) by one recording alone, and their covariance: a constant per joint, then the causes."""

    name: str
    values: Array
    covariance: Array


def alone(chosen: Chosen, model: LinkEncoders) -> list[Alone]:
    """Every recording fitted alone; one entry where there is one recording, split by time."""
    found = []
    for rows in model.recordings:
        x, values = model.stacked(chosen, rows), model.fitted(chosen, rows)
        residual = model.response(rows) - x @ values
        block = np.tile(rows.blocks(BLOCK_SECONDS), len(rows.joints))
        covariance = cluster_covariance(x, [residual], block) + np.diag((SAME * values) ** 2)
        found.append(Alone(rows.names[0], values, covariance))
    return found


def contradicted(chosen: Chosen, model: LinkEncoders) -> LinkCandidate | None:
    """The cause of which the recordings contradict each other most; None where all agree."""
    seen = alone(chosen, model)
    if len(seen) < 2:
        return None
    chances = {candidate: chance_of(seen, _place(candidate, chosen, model)) for candidate in chosen}
    worst = min(chances, key=lambda candidate: chances[candidate], default=None)
    return worst if worst is not None and chances[worst] < CHANCE / len(chosen) else None


def chance_of(seen: Sequence[Alone], place: slice) -> float:
    """Probability that coefficients at ``place`` differ as they do between recordings, were they the same in all."""
    precise = [np.linalg.pinv(one.covariance[place, place]) for one in seen]
    mean = np.linalg.pinv(np.sum(precise, axis=0)) @ sum(p @ one.values[place] for p, one in zip(precise, seen))
    apart = [one.values[place] - mean for one in seen]
    distance = float(sum(d @ p @ d for d, p in zip(apart, precise)))
    return float(stats.chi2.sf(distance, (len(seen) - 1) * len(mean)))


def _place(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders) -> slice:
    at = len(model.rows.fit.joints) + sum(c.width for c in chosen[: chosen.index(candidate)])
    return slice(at, at + candidate.width)
