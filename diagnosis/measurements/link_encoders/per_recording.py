"""What each recording alone says of the causes between two encoders, and whether the recordings contradict each other.

A property of an arm is the same in every recording. A value that differs by more than its deviations belongs to the
recording, as the zero of an incremental encoder does, or the cause is not what the difference between the encoders is
made of.
"""

from __future__ import annotations

import numpy as np

from diagnosis.measurements.link_encoders.candidates import LinkCandidate
from diagnosis.measurements.link_encoders.model import Chosen, LinkEncoders
from diagnosis.selection.contradiction import CHANCE, SAME, SingleEstimate, chance_of
from identification.selection import BLOCK_SECONDS
from identification.selection.cluster_covariance import cluster_covariance


def single_estimates(chosen: Chosen, model: LinkEncoders) -> list[SingleEstimate]:
    """Every recording fitted alone: a constant per joint, then the causes.

    A single recording that was split by time gives one entry.
    """
    estimates = []
    for rows in model.recordings:
        x, values = model.stacked(chosen, rows), model.fitted(chosen, rows)
        residual = model.response(chosen, rows) - x @ values
        block = np.tile(rows.blocks(BLOCK_SECONDS), len(rows.joints))
        covariance = cluster_covariance(x, [residual], block) + np.diag((SAME * values) ** 2)
        estimates.append(SingleEstimate(rows.names[0], values, covariance))
    return estimates


def contradicted(chosen: Chosen, model: LinkEncoders) -> LinkCandidate | None:
    """The cause whose values differ most between recordings; None if all agree."""
    seen = single_estimates(chosen, model)
    if len(seen) < 2:
        return None
    chances = {candidate: chance_of(seen, place_of(candidate, chosen, model)) for candidate in chosen}
    worst = min(chances, key=lambda candidate: chances[candidate], default=None)
    return worst if worst is not None and chances[worst] < CHANCE / len(chosen) else None


def place_of(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders) -> slice:
    """Where the coefficients of a chosen candidate are, behind a constant per joint."""
    at = len(model.rows.fit.joints) + sum(c.width for c in chosen[: chosen.index(candidate)])
    return slice(at, at + candidate.width)
