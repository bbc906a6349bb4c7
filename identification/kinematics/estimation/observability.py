"""What a set of poses shows of the parameters: identifiable rank, and the observability indices O1 to O5.

O1 to O5 from the singular values s1 >= ... >= sp of the identification Jacobian, columns per unit of what is expected
of each parameter, for m poses (Sun and Hollerbach, "Observability index selection for robot calibration", ICRA 2008):

    O1 = (s1 ... sp)^(1/p) / sqrt(m)   Borm and Menq: D-optimality        O2 = sp / s1     Driels and Pathre: condition
    O3 = sp                            Nahvi et al.: E-optimality         O4 = sp^2 / s1   noise amplification, Nahvi
                                       and Hollerbach
    O5 = 1 / (1/s1 + ... + 1/sp)       A-optimality
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.observed import linear_in
from identification.kinematics.models.parameters import Parameters

MOST_POSES = 2000
"""Poses that a rank is computed from: an even choice of more."""
RANK_TOLERANCE = 1e-8
"""Relative to the largest singular value.

Parameters that do the same thing come out at 1e-16, distinct ones above 1e-4.
"""
RESTING = np.radians(0.5)
"""A joint (rad; m for prismatic ones) that moves less than this rests: its encoder's flicker is no motion."""


@dataclass(frozen=True)
class Observability:
    """The five indices."""

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float


def at_rest(q: Array) -> Array:
    """q (N, joints) with the joints that rest put to their median, (moving joints stay)."""
    q = np.array(q, float)
    for j in range(q.shape[1]):
        if len(q) and np.ptp(q[:, j]) < RESTING:
            q[:, j] = np.median(q[:, j])
    return q


def identifiable(parameters: Parameters, poses: ArrayLike | Points) -> int:
    """How many independent combinations of ALL parameters (base, joints, targets) ``poses`` can show.

    poses: angles q (N, joints) of the first target, or what was measured of all targets. 27 for a 6R arm and 15 for a
    3R arm in general poses (``expected_rank``).
    """
    points = _points(poses)
    points = replace(points, q=at_rest(points.q)).where(slice(None, None, max(1, len(points) // MOST_POSES)))
    jacobian = linear_in(parameters.chain, points)[1]
    columns = jacobian[:, :, parameters.every].reshape(-1, len(parameters.every))
    return int(np.sum(singular_values(columns) > RANK_TOLERANCE * float(np.linalg.norm(columns))))


def expected_rank(revolute: int, prismatic: int, targets: int, oriented: int) -> int:
    """``identifiable`` of general poses: 4 a revolute joint, 2 a prismatic one, 3 a target and 3 more if oriented.

    Source: Everett and Hsu, IEEE T-RA 1988, for a full pose; a point has three less.
    """
    return 4 * revolute + 2 * prismatic + 3 * targets + 3 * oriented


def singular_values(columns: Array) -> Array:
    """Singular values of (rows, p), by the small triangular factor of a QR decomposition where rows are many."""
    if columns.shape[0] > 4 * columns.shape[1]:
        columns = np.asarray(np.linalg.qr(columns, mode="r"), float)
    return np.asarray(np.linalg.svd(columns, compute_uv=False), float)


def indices(columns: Array, rank: int, poses: int) -> Observability:
    """O1 to O5 over the ``rank`` identifiable directions of (rows, p) scaled columns, for ``poses`` poses."""
    s = singular_values(columns)[:rank]
    if len(s) < rank or s[-1] <= 0:
        return Observability(0.0, 0.0, 0.0, 0.0, 0.0)
    geometric = float(np.exp(np.mean(np.log(s))))
    return Observability(
        o1=geometric / np.sqrt(poses),
        o2=float(s[-1] / s[0]),
        o3=float(s[-1]),
        o4=float(s[-1] ** 2 / s[0]),
        o5=float(1.0 / np.sum(1.0 / s)),
    )


def scaled_jacobian(parameters: Parameters, poses: ArrayLike | Points) -> Array:
    """(N, 3, free): derivatives of the point per prior deviation of each free value, m.

    poses as in ``identifiable``.
    """
    jacobian = linear_in(parameters.chain, _points(poses))[1]
    return jacobian[:, :, parameters.free] * parameters.scale[parameters.free]


def _points(poses: ArrayLike | Points) -> Points:
    if isinstance(poses, Points):
        return poses
    q = np.atleast_2d(np.asarray(poses, float))
    return Points(q, np.zeros((len(q), 3)))
