"""Which poses to measure: D-optimal selection, how many are enough, and an experiment file that ``record`` runs.

Each pose adds J'J / sigma^2 to the information about the parameters. From many random poses within limits those are
taken, one by one, that raise its determinant most, and then exchanged while that gains (Fedorov, "Theory of Optimal
Experiments", 1972; for arms, Daney, Papegay and Madeline, IJRR 24(12), 2005). The priors make the determinant finite
from the first pose on and keep directions out of it that no pose shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import link_frames
from experiment import Experiment
from experiment.segments import Hold, Move, Segment
from identification.kinematics.estimation.observability import Observability, identifiable, indices, scaled_jacobian
from identification.kinematics.models.parameters import Target, Trust, parameters_of
from identification.kinematics.use.correction import limits_of

ENOUGH = np.sqrt(1.1**2 - 1.0)
"""A model error of 0.458 of the tracker's noise adds a tenth to the rms of a measured point: that counts as reached."""
FLOOR = 0.05
"""m: least height above the floor (0 in the base frame)."""
COLUMN = 0.25
"""m: least distance of the target from the axis of joint 1."""
HOLD = 0.6
"""s for which the arm stands at each pose."""
SPEED = 0.5
"""Share of the full speed at which the arm goes from pose to pose."""


@dataclass(frozen=True)
class PosePlan:
    """Selected poses and what they promise.

    q           (N, joints) rad, in an order of short ways
    error       (N,) m: model error (rms a coordinate, over the whole workspace) expected with the first 1, 2 .. N poses
                selected
    enough      how many poses bring it to ENOUGH x noise; None: more than N
    random      m: the same error for N random poses, for comparison
    """

    q: Array
    error: Array
    enough: int | None
    random: float
    identifiable: int
    observability: Observability


def select_poses(
    arm: Arm,
    target: tuple[float, float, float],
    count: int,
    *,
    noise: float = 1e-4,
    candidates: int = 1500,
) -> PosePlan:
    """``count`` poses for a tracked ``target`` (3,) m and tracker noise of ``noise`` m a coordinate and point.

    Candidates are random within 95 % of the joint ranges; those are left out that bring a link's origin beyond the
    shoulder, or the target, lower than ``FLOOR``, or the target nearer than ``COLUMN`` to the axis of joint 1, which is
    the arm's own column. A person must still check that the cell has room. InputError: fewer than two poses, or too few
    that are possible.
    """
    if count < 2:
        raise InputError("--poses", f"{count} poses determine nothing; use at least 2, better 30")
    parameters = parameters_of(arm, [Target(target)], frame_known=True, trust=Trust())
    generator = np.random.default_rng(0)
    pool = allowed_poses(arm, target, candidates, generator)
    if len(pool) < count:
        rest = "ask for fewer" if len(pool) >= 2 else "is its base above the floor, and are its limits right?"
        raise InputError(
            "--poses",
            f"only {len(pool)} of {candidates} random poses keep the arm off the floor and its target off the column; "
            f"{rest}",
        )
    information = scaled_jacobian(parameters, arm.link_angles(pool)) / noise
    chosen = _exchange(information, _greedy(information, count))
    check = scaled_jacobian(parameters, arm.link_angles(allowed_poses(arm, target, 600, generator)))
    error = np.array([_model_error(information[chosen[: k + 1]], check) for k in range(count)])
    reached = np.flatnonzero(error <= ENOUGH * noise)
    q = pool[chosen]
    columns = scaled_jacobian(parameters, arm.link_angles(q))
    rank = identifiable(parameters, arm.link_angles(q))
    return PosePlan(
        q=q[_short_way(q)],
        error=error,
        enough=int(reached[0]) + 1 if len(reached) else None,
        random=_model_error(information[generator.choice(len(pool), count, replace=False)], check),
        identifiable=rank,
        observability=indices(columns.reshape(-1, columns.shape[2]), min(rank, columns.shape[2]), count),
    )


def allowed_poses(arm: Arm, target: tuple[float, float, float], count: int, generator: np.random.Generator) -> Array:
    """Up to ``count`` random poses (N, joints) that keep off the floor and the arm's own column."""
    low, high = limits_of(arm)
    middle, half = (low + high) / 2, 0.95 * (high - low) / 2
    q = generator.uniform(middle - half, middle + half, (6 * count, len(arm)))
    frames = link_frames(arm, arm.link_angles(q))
    point = frames[:, -1, :3, :3] @ np.array(target) + frames[:, -1, :3, 3]
    heights = np.column_stack((frames[:, 2:, 2, 3], point[:, 2]))
    column = np.array(arm.base)
    across = point - column[:3, 3]
    across = across - np.outer(across @ column[:3, 2], column[:3, 2])
    good = (heights > FLOOR).all(axis=1) & (np.linalg.norm(across, axis=1) > COLUMN)
    return q[good][:count]


def experiment_of(arm: Arm, plan: PosePlan, *, rows: int | None = None) -> Experiment:
    """The experiment that visits the poses, standing ``HOLD`` s at each.

    rows: the tracker's memory; the rate is then chosen so that the whole run fits into it.
    """
    full = []
    for joint in arm.joints:
        fastest = 1.0 if joint.motor_speed_limit is None else joint.motor_speed_limit / abs(joint.gear)
        full.append(min(fastest, 2.0) * SPEED)
    segments: list[Segment] = []
    start = [0.0] * len(arm)
    low, high = limits_of(arm)
    start = [float(v) for v in np.clip(start, low, high)]
    duration = 0.0
    at = np.array(start)
    for q in plan.q:
        segments += [Move(type="move", to=[round(float(v), 6) for v in q]), Hold(type="hold", duration=HOLD)]
        way = np.abs(q - at)
        duration += HOLD + float(np.max(np.maximum(way / full + np.array(full) / 2.0, 2 * np.sqrt(way / 2.0))))
        at = q
    return Experiment(
        name=f"{len(plan.q)} poses for calibration",
        description="D-optimal poses; the arm stands at each long enough for the tracker",
        start=start,
        full_speed=full,
        full_acceleration=[2.0] * len(arm),
        rate=None if rows is None else max(1.0, np.floor(rows / (1.1 * duration))),
        segment=segments,
    )


def _greedy(information: Array, count: int) -> list[int]:
    """The poses that raise log det(I + sum J'J) most, one after the other (matrix determinant lemma)."""
    inverse = np.eye(information.shape[2])
    chosen: list[int] = []
    for _ in range(count):
        gain = _gains(information, inverse)
        gain[chosen] = -np.inf
        chosen.append(int(gain.argmax()))
        inverse = _updated(inverse, information[chosen[-1]])
    return chosen


def _exchange(information: Array, chosen: list[int]) -> list[int]:
    """Every selected pose in turn is taken out and the best of all put in."""
    chosen = list(chosen)
    for _ in range(2):
        changed = False
        for k in range(len(chosen)):
            rest = [c for i, c in enumerate(chosen) if i != k]
            stacked = information[rest].reshape(-1, information.shape[2])
            gain = _gains(information, np.asarray(np.linalg.inv(stacked.T @ stacked + np.eye(information.shape[2]))))
            gain[rest] = -np.inf
            best = int(gain.argmax())
            if gain[best] > gain[chosen[k]] + 1e-9:
                chosen[k], changed = best, True
        if not changed:
            break
    return chosen


def _gains(information: Array, inverse: Array) -> Array:
    """(N,) log det(I3 + J A^-1 J') of every candidate (N, 3, p); inverse (p, p): A^-1."""
    small = np.einsum("nip,njp->nij", information @ inverse, information) + np.eye(3)
    return np.linalg.slogdet(small)[1]


def _updated(inverse: Array, rows: Array) -> Array:
    """(p, p) (A + J'J)^-1 from A^-1 (p, p), with J = ``rows`` (k, p) (Woodbury)."""
    gained = inverse @ rows.T
    return inverse - gained @ np.linalg.solve(np.eye(len(rows)) + rows @ gained, gained.T)


def _model_error(information: Array, check: Array) -> float:
    """Expected rms error per coordinate (m) of the calibrated model at the check poses (N, 3, p).

    ``information`` is that of the poses that would be measured.
    """
    stacked = information.reshape(-1, information.shape[2])
    covariance = np.linalg.inv(stacked.T @ stacked + np.eye(information.shape[2]))
    return float(np.sqrt(np.mean(np.einsum("nip,nip->ni", check @ covariance, check))))


def _short_way(q: Array) -> list[int]:
    """An order of the poses that always continues with the nearest one left, by the largest joint travel.

    It begins with the pose nearest to zero.
    """
    unvisited = list(range(len(q)))
    at = np.zeros(q.shape[1])
    order = []
    while unvisited:
        nearest = min(unvisited, key=lambda k: float(np.abs(q[k] - at).max()))
        order.append(nearest)
        unvisited.remove(nearest)
        at = q[nearest]
    return order
