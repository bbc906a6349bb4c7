"""What a unit of each coefficient of a candidate adds to the difference of motor and link encoder."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from diagnosis.measurements.link_encoders.candidates import LinkCandidate
from diagnosis.measurements.link_encoders.rows import Rows
from diagnosis.residual.signals import direction_of


def columns(candidate: LinkCandidate, rows: Rows, k: int) -> Array:
    """(m, c) rad: what a unit of each of c coefficients adds to the encoder difference at the k-th joint of ``rows``.

    c = 0 where the candidate does not act.
    """
    if candidate.turns:  # q_link = (1 + C) q
        return _turned(candidate, rows, int(rows.joints[k]))
    if candidate.joint is None:  # q(t) - q(t - delay)
        return rows.v[:, k, None]
    if rows.joints[k] != candidate.joint:
        return np.empty((rows.rows, 0))
    q, load, largest = rows.q[:, k], rows.load[:, k], float(rows.largest[k])
    match candidate.variant:
        case "drag", drag:
            late = candidate.lag * rows.load_rate[:, k]
            return (load - late - drag * largest * direction_of(rows.v[:, k]))[:, None]
        case "by_load", _:
            return np.sign(load)[:, None]
        case "half_gap", half_gap:
            return _play(q, half_gap, rows.starts)[:, None] / half_gap
        case "order", _:
            return candidate.waves(rows.ratio[k] * q)
    return candidate.waves(q)


def _turned(coupling: LinkCandidate, rows: Rows, joint: int) -> Array:
    """``columns`` of a coupling at a joint (from 1)."""
    places = [place for place, (axis, _) in enumerate(coupling.turns) if axis == joint]
    columns = np.zeros((rows.rows, coupling.width if places else 0))
    for place in places:
        columns[:, place] = -rows.q[:, rows.joints == coupling.turns[place][1]][:, 0]
    return columns


def _play(q: Array, half_gap: float, starts: tuple[int, ...]) -> Array:
    """(m,) rad: motor minus link where friction holds the link, for motor angles q (m,) rad.

    The link moves only while the motor is at either side of the gap. starts: rows at which a recording begins.
    """
    out = np.empty_like(q)
    begun = set(starts)
    d, before = 0.0, q[0]
    for row, angle in enumerate(q.tolist()):
        d = 0.0 if row in begun else min(max(d + angle - before, -half_gap), half_gap)
        out[row], before = d, angle
    return out
