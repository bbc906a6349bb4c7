"""Orientations of 6-D targets: the frame that they are of, and how much they count beside positions.

How a target's frame is turned on the link is not known. Measured orientations are first put in a frame that is nearly
parallel to the link's, so that its three angles are small; these are then estimated like everything else. An error of 1
rad counts as one of ``lever`` metres: the noise of positions over that of orientations, both from the residuals.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from arm_io.types import Array
from identification.kinematics.data.measured import Measured
from identification.kinematics.data.points import Points
from identification.kinematics.data.runs import Run
from identification.kinematics.models.chain import Chain, forward
from identification.selection import MEDIAN_OF_NORM

_LEAST = 1e-3
"""m: smallest lever, where positions have no noise."""
_MOST = 1e2
"""m: largest lever, where orientations have no noise."""
_LEAST_ANGLE = 1e-6
"""rad, less than the noise of any orientation: the scale of simulated ones without noise."""
_LEAST_LEFT = 0.02
"""Least share of the noise's variance in residuals that is believed: they tell nothing where parameters absorb all."""


def with_aims(measured: Measured, chain: Chain) -> Measured:
    """The same with orientations of frames that are nearly parallel to those of the links by ``chain``."""
    turns = aimed(chain, measured.points)
    if not turns:
        return measured
    aims = {number: turn @ measured.aims.get(number, np.eye(3)) for number, turn in turns.items()}
    return replace(measured.each(lambda run: realigned(run, turns)), aims={**measured.aims, **aims})


def with_lever(measured: Measured, residual: Array, left: Array | None = None) -> Measured:
    """The same with orientations weighed by the ratio of both noises, as the residuals (N, 3) of its points show it.

    left: as in ``lever_of``.
    """
    lever = lever_of(measured.points, residual, left)
    if lever is None:
        return measured
    return measured.each(lambda run: replace(run, lever=lever) if run.lever else run)


def aimed(chain: Chain, points: Points) -> dict[int, Array]:
    """(3, 3) by target with orientations: X for which predicted orientations times X fit the measured ones best.

    In the chordal sense (Hartley et al., "Rotation averaging", IJCV 2013): the orthogonal factor of the mean.
    """
    found = {}
    oriented = points.oriented
    target = np.zeros(len(points), int) if points.target is None else points.target
    for number in np.unique(target[oriented]):
        of_target = points.where(oriented & (target == number))
        predicted = forward(chain, of_target.q, of_target.target)[:, :3, :3]
        each = np.swapaxes(predicted, 1, 2) @ Rotation.from_rotvec(of_target.xyz).as_matrix()
        u, _, v = np.linalg.svd(each.mean(axis=0))
        found[int(number)] = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    return found


def realigned(run: Run, turns: dict[int, Array]) -> Run:
    """The run with its orientations R (if it has any) replaced by R X', for X (3, 3) of its target."""
    if not run.lever or run.target not in turns:
        return run
    xyz, rows = run.xyz.copy(), run.usable
    turn = Rotation.from_matrix(turns[run.target])
    xyz[rows] = (Rotation.from_rotvec(run.xyz[rows]) * turn.inv()).as_rotvec()
    return replace(run, xyz=xyz)


def lever_of(points: Points, residual: Array, left: Array | None = None) -> float | None:
    """m: noise of positions over that of orientations (robust), from residuals (N, 3) m; None: no orientations.

    left (N,), 0 to 1: share of the noise's variance that the fit left in each residual. Few poses decide many
    parameters, by positions and orientations in unequal parts (Foerstner, "Ein Verfahren zur Schaetzung von Varianz-
    und Kovarianzkomponenten", Allg. Vermessungs-Nachr. 86, 1979). None: all of it.
    """
    oriented = points.oriented
    if not oriented.any() or points.lever is None:
        return None
    length = np.linalg.norm(residual, axis=1)
    rest = np.ones(len(length)) if left is None else left
    noises = []
    for which, unit in ((~oriented, 1.0), (oriented, points.lever[oriented])):
        share = max(float(np.mean(rest[which])), _LEAST_LEFT)
        noises.append(float(np.median(length[which] / unit)) / MEDIAN_OF_NORM / np.sqrt(share))
    return float(np.clip(max(noises[0], 1e-7) / max(noises[1], _LEAST_ANGLE), _LEAST, _MOST))
