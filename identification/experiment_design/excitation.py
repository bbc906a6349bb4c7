"""The motion that shows an arm's parameters best, inside its limits, as an experiment that ``record`` runs.

A finite Fourier series for each joint (Swevers et al., IEEE T-RA 13(5), 1997) about a pose that is searched with it.
Whatever the search proposes is scaled into the limits of position, speed, acceleration and torque, so that every
candidate is feasible. Effects of the model count with the parameters in which they are linear. Criteria:

d            determinant of the information matrix of the base parameters, rows weighted by each joint's torque limit:
             smallest volume of the confidence ellipsoid
condition    condition number of the weighted regressor, columns scaled by the parameters' expected size: no direction
             neglected
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

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
from identification.regression.base_parameters import BaseParameters, structural_base
from identification.regression.model_parameters import model_columns, model_values

Criterion = Literal["d", "condition"]
Progress = Callable[[float, str], None]

TWENTY_SECONDS = Series()
ROUNDED = 1e-5
"""Share of a column: a smaller remainder comes from rounded angles in the file (1.5708)."""
CLOSE = 0.98
"""Share of a limit that is used: peaks may lie between the instants that are checked."""
TOGETHER = 16
"""Candidates judged at a time."""
PRODUCT = 1e-11
"""Smallest over largest eigenvalue of A^T A: above it, rounding changes a singular value by 1e-5."""
HIDDEN = -1e6
"""Larger than any score: a motion that excites more parameters is always better."""
STILL = 0.02
"""Smallest scale of a motion: with a smaller one the arm hardly moves."""
ROWS = 160
"""Instants at which a candidate is judged."""


def design_excitation(
    arm: Arm,
    series: Series = TWENTY_SECONDS,
    *,
    criterion: Criterion = "d",
    limits: Limits | None = None,
    candidates: int = 1600,
    seed: int = 1,
    progress: Progress = lambda _share, _text: None,
) -> Experiment:
    """The best of ``candidates`` motions: random ones first, then steps from the best that shrink when they fail.

    The same seed gives the same motion. ``progress`` is called with the share done and the best score so far, in words.
    InputError where no motion keeps clear of what ``limits.pairs`` names, and where the limits of torque do not let the
    arm move.
    """
    limits = limits or Limits.of(arm)
    base = structural_base(arm, negligible=ROUNDED)
    random = np.random.default_rng(seed)
    # sixty a period of the fastest harmonic, fades included
    rows = int(60 * (series.harmonics * series.fundamental * series.duration + 4))
    task, judged = _Task(arm, limits, series, Shapes.of(series, rows)), Shapes.of(series, ROWS)
    best, best_score, step = _random(task, random), -np.inf, 0.5
    generations = max(2, candidates // TOGETHER)
    for generation in range(generations):
        if generation < generations // 5:
            trials = [_random(task, random) for _ in range(TOGETHER)]
        else:
            steps = step * random.standard_normal((TOGETHER, *best.shape))
            trials = list(best + steps * (random.random(steps.shape) < 0.3))
        start, weights, clear = _feasible(task, np.stack(trials))
        scores = np.full(len(trials), -np.inf)
        if clear.any():
            motions = judged.motions(start[clear], weights[clear])
            scores[clear] = scores_of(arm, base, judged.t, motions, limits, criterion)
        winner = int(np.argmax(scores))
        if scores[winner] > best_score:
            best, best_score = trials[winner], float(scores[winner])
            step = min(1.2 * step, 1.0)
        elif generation >= generations // 5:
            step = max(0.9 * step, 0.02)
        progress(generation / generations, f"{criterion} {_shown(best_score, criterion)}")
    if not np.isfinite(best_score):
        raise _none_found(task)
    return _checked(task, best)


@dataclass(frozen=True)
class _Task:
    """The arm, the limits and the form of the motions to be designed, and the instants at which limits are checked."""

    arm: Arm
    limits: Limits
    series: Series
    shapes: Shapes


def scores_of(
    arm: Arm,
    base: BaseParameters,
    t: Array,
    motions: tuple[Array, Array, Array],
    limits: Limits,
    criterion: Criterion,
) -> Array:
    """(m,) of m motions q, q', q'' (m, k, n) at the instants ``t`` (k,); larger is better.

    Log determinant of the information, or minus the log of the condition number, of the directions that the motion
    shows; those that it does not show count ``HIDDEN`` each.
    """
    count = len(motions[0])
    q, qd, qdd = (motion.reshape(-1, len(arm)) for motion in motions)
    columns = model_columns(arm, q, qd, qdd, t=np.tile(t, count))[:, :, base.kept]
    torque = np.where(np.isfinite(limits.torque), limits.torque, 1.0)
    # In units of what the model expects each parameter to be, so that a condition number means something.
    expected = np.abs(base.grouping @ model_values(arm))
    size = np.maximum(expected, 0.1 * np.median(expected[expected > 0]) if (expected > 0).any() else 1.0)
    rows = (columns / torque[None, :, None] * size).reshape(count, -1, len(base))
    values = singular_values(rows)
    shown = values > 1e-12 * values[:, :1]
    logs = np.where(shown, np.log(np.maximum(values, 1e-300)), 0.0)
    least = np.where(shown, logs, np.inf).min(axis=1)
    score = 2 * logs.sum(axis=1) if criterion == "d" else least - logs[:, 0]
    return np.where(shown.any(axis=1), score + HIDDEN * (~shown).sum(axis=1), -np.inf)


LARGEST_CONDITION = 1e12
"""Condition number from which on double precision tells nothing of the least singular value."""


def singular_values(rows: Array) -> Array:
    """(k, c) of matrices (k, m, c), m >= c, the largest first.

    As roots of the eigenvalues of their products A^T A, a sixtieth of the time of a decomposition of each A; of those
    so ill-conditioned (``PRODUCT``) that the product has lost the least ones, of A itself.
    """
    squares = np.linalg.eigvalsh(np.swapaxes(rows, -1, -2) @ rows)[:, ::-1]
    values = np.sqrt(np.maximum(squares, 0.0))
    lost = squares[:, -1] < PRODUCT * squares[:, 0]
    if lost.any():
        values[lost] = np.linalg.svd(rows[lost], compute_uv=False)
    return np.asarray(values)


def _shown(score: float, criterion: Criterion) -> str:
    """A score as it is printed: log det, or the condition number, beyond any number if parameters are hidden."""
    if criterion == "d":
        return f"{score:.1f}"
    return f"{np.exp(-score):.0f}" if -score < np.log(LARGEST_CONDITION) else f"above {LARGEST_CONDITION:.0e}"


def _random(task: _Task, random: np.random.Generator) -> Array:
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


def _start(task: _Task, proposals: Array) -> Array:
    """(m, n) the poses about which the proposals (m, n, 1 + 2 harmonics) move."""
    low, high = task.limits.position.T
    return np.asarray((low + high) / 2 + 0.5 * (high - low) / 2 * np.tanh(proposals[:, :, 0]))


def _held(task: _Task, poses: Array) -> NDArray[np.bool_]:
    """Which of the poses (k, n) the motors hold within the limits of torque."""
    rest = np.zeros_like(poses)
    weight = np.abs(inverse_dynamics(task.arm, poses, rest, rest))
    return np.asarray((weight <= CLOSE * task.limits.torque).all(axis=1))


def _checked(task: _Task, proposal: Array) -> Experiment:
    """The best proposal that is clear at every instant; InputError if none is clear even at the checked instants."""
    share = 1.0
    (start,), (weights,), (clear,) = _feasible(task, proposal[None])
    while clear and share >= SMALLEST:
        motion = fourier_motion(share * weights, start, task.limits, task.series)
        if task.limits.pairs is None or is_clear(demand_of(motion), task.limits.pairs):
            return motion
        share *= 0.95
    raise _not_clear(task)


def _feasible(task: _Task, proposals: Array) -> tuple[Array, Array, Array]:
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


def _within_torque(task: _Task, start: Array, q: Array, qd: Array, qdd: Array, scale: Array) -> Array:
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


def _none_found(task: _Task) -> InputError:
    """The error that says why no candidate can be run."""
    random = np.random.default_rng(0)
    proposals = np.stack([_random(task, random) for _ in range(DRAWN)])
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


def _not_clear(task: _Task) -> InputError:
    assert task.limits.pairs is not None
    low, high = task.limits.position.T
    return none_is_clear(task.limits.pairs, low + (high - low) / 4, high - (high - low) / 4)
