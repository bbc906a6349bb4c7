"""Motions that an arm can follow: proposals scaled into its limits of position, speed, torque and space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.system import inverse_dynamics
from experiment import Experiment, demand_of
from identification.experiment_design.fourier_series import Series, Shapes, fourier_motion
from identification.experiment_design.keep_clear import (
    DRAWN,
    SMALLEST,
    clear_poses,
    clear_share,
    is_clear,
    none_is_clear,
)
from identification.experiment_design.limits import Limits

CLOSE = 0.98
"""Share of a limit that is used: peaks may lie between the instants that are checked."""
STILL = 0.02
"""Smallest scale of a motion: with a smaller one the arm hardly moves."""


@dataclass(frozen=True)
class Task:
    """The arm, the limits and the form of the motions to be designed, and the instants at which limits are checked."""

    arm: Arm
    limits: Limits
    series: Series
    shapes: Shapes


def drawn(task: Task, random: np.random.Generator) -> Array:
    """(n, 1 + 2 harmonics): pose, sines, cosines, in units of the limits; higher harmonics smaller."""
    harmonics = task.series.harmonics
    proposal = random.standard_normal((len(task.arm), 1 + 2 * harmonics))
    proposal[:, 1:] /= np.tile(np.arange(1, harmonics + 1), 2)
    pairs = task.limits.pairs
    low, high = task.limits.position.T
    quarter = (high - low) / 4
    if pairs is not None or not _held(task, _start(task, proposal[None]))[0]:
        poses = low + quarter + (high - low - 2 * quarter) * random.random((DRAWN, len(low)))
        possible = np.flatnonzero(_held(task, poses) & (True if pairs is None else clear_poses(pairs, poses)))
        if len(possible):
            middle = (low + high) / 2
            proposal[:, 0] = np.arctanh(np.clip((poses[possible[0]] - middle) / quarter, -0.999, 0.999))
    return np.asarray(proposal)


def _start(task: Task, proposals: Array) -> Array:
    """(m, n) the poses about which the proposals (m, n, 1 + 2 harmonics) move."""
    low, high = task.limits.position.T
    return np.asarray((low + high) / 2 + 0.5 * (high - low) / 2 * np.tanh(proposals[:, :, 0]))


def _held(task: Task, poses: Array) -> NDArray[np.bool_]:
    """Which of the poses (k, n) the motors hold within the limits of torque."""
    rest = np.zeros_like(poses)
    weight = np.abs(inverse_dynamics(task.arm, poses, rest, rest))
    return np.asarray((weight <= CLOSE * task.limits.torque).all(axis=1))


def checked(task: Task, proposal: Array) -> Experiment:
    """The best proposal that is clear at every instant; InputError if none is clear even at the checked instants."""
    share = 1.0
    (start,), (weights,), (clear,) = feasible(task, proposal[None])
    while clear and share >= SMALLEST:
        motion = fourier_motion(share * weights, start, task.limits, task.series)
        if task.limits.pairs is None or is_clear(demand_of(motion), task.limits.pairs):
            return motion
        share *= 0.95
    raise _not_clear(task)


def feasible(task: Task, proposals: Array) -> tuple[Array, Array, Array]:
    """The proposals (m, n, 1 + 2 harmonics) scaled into the limits.

    Returns start (m, n), coefficients (m, n, 2 harmonics), and whether each can be followed and is clear of the space
    (m,).
    """
    limits, shapes = task.limits, task.shapes
    low, high = limits.position.T
    start = _start(task, proposals)
    weights = proposals[:, :, 1:]
    q, qd, qdd = shapes.motions(np.zeros_like(start), weights)
    room = np.minimum(
        (high - start) / np.maximum(q.max(axis=1), 1e-9), (start - low) / np.maximum(-q.min(axis=1), 1e-9)
    )
    quick = limits.speed / np.maximum(np.abs(qd).max(axis=1), 1e-9)
    fierce = limits.acceleration / np.maximum(np.abs(qdd).max(axis=1), 1e-9)
    scale = CLOSE * np.minimum.reduce([room, quick, fierce])
    scale = _within_torque(task, start, q[:, ::4], qd[:, ::4], qdd[:, ::4], scale)
    if limits.pairs is not None:
        shares = [clear_share(limits.pairs, *one) for one in zip(start, q[:, ::4] * scale[:, None, :])]
        scale = scale * np.array(shares)[:, None]
    return start, weights * scale[:, :, None], scale.any(axis=1)


def _within_torque(task: Task, start: Array, q: Array, qd: Array, qdd: Array, scale: Array) -> Array:
    """The scales (m, n) of motions (m, k, n) made smaller until the motors can follow.

    All joints are scaled together, since their dynamics are coupled. 0 where the motors hardly hold the arm.
    """
    share = np.ones(len(scale))
    over = share > 0
    while over.any():
        asked = share[over, None, None] * scale[over][:, None, :]
        states = (start[over][:, None, :] + q[over] * asked, qd[over] * asked, qdd[over] * asked)
        torque = inverse_dynamics(task.arm, *(each.reshape(-1, q.shape[2]) for each in states))
        worst = np.abs(torque).reshape(-1, *q.shape[1:]).max(axis=1)
        over[over] = (worst > CLOSE * task.limits.torque).any(axis=1)
        share[over] *= 0.85
        share[share < STILL] = 0.0
        over &= share > 0
    return scale * share[:, None]


def none_found(task: Task) -> InputError:
    """The error that says why no candidate can be run."""
    random = np.random.default_rng(0)
    proposals = np.stack([drawn(task, random) for _ in range(DRAWN)])
    start = _start(task, proposals)
    slow = 1e-3 * task.limits.speed * np.sign(random.standard_normal(start.shape))  # against friction
    needed = np.abs(inverse_dynamics(task.arm, start, slow, np.zeros_like(start)))
    heavy = needed > CLOSE * task.limits.torque
    if not heavy.any() and task.limits.pairs is not None:
        return _not_clear(task)
    joint = int(np.argmax(heavy.sum(axis=0)))
    unit = "N m" if task.arm.joints[joint].revolute else "N"
    return InputError(
        "excite",
        f"no motion is within the limits of torque: to move slowly, joint {joint + 1} needs "
        f"{np.median(needed[:, joint]):.3g} {unit} in half of the poses, and may use {task.limits.torque[joint]:.3g}; "
        "correct torque_limit, masses or friction of the model, or the limits of the rig",
    )


def _not_clear(task: Task) -> InputError:
    assert task.limits.pairs is not None
    low, high = task.limits.position.T
    return none_is_clear(task.limits.pairs, low + (high - low) / 4, high - (high - low) / 4)
