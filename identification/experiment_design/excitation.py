"""The motion that shows an arm's parameters best, inside its limits, as an experiment that ``record`` runs.

A finite Fourier series for each joint (Swevers et al., IEEE T-RA 13(5), 1997) about a pose that is searched with it.
Whatever the search proposes is scaled into the limits of position, speed, acceleration and torque, so that every
candidate is feasible. Criteria:

Effects of the model count with the parameters in which they are linear.

d            determinant of the information matrix of the base parameters, rows weighted by each joint's torque limit:
             smallest volume of the confidence ellipsoid
condition    condition number of the weighted regressor, columns scaled by the parameters' expected size: no direction
             neglected
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from arm_clearance import Pairs
from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.system import inverse_dynamics
from experiment import Experiment, demand_of
from experiment.segments import Fourier, Hold
from identification.experiment_design.keep_clear import SMALLEST, clear_share, clear_start, is_clear, none_is_clear
from identification.regression.base_parameters import BaseParameters, structural_base
from identification.regression.model_parameters import model_columns, model_values

Criterion = Literal["d", "condition"]
Progress = Callable[[float, str], None]

CLOSE = 0.98  # of a limit: what may hide between the instants looked at
TOGETHER = 16  # candidates judged at a time
PRODUCT = 1e-11  # least eigenvalue of A^T A over its largest: above it, rounding changes a singular value by 1e-5
ROWS = 160  # instants at which a candidate is judged
SPEED, ACCELERATION = 1.0, 3.0  # rad/s, rad/s2 where a model states no limit: a careful laboratory arm


@dataclass(frozen=True)
class Limits:
    """position (n, 2) rad, speed (n,) rad/s, acceleration (n,) rad/s2, torque (n,) N m.

    m and N for prismatic joints. pairs: the distances that must be kept; None: nothing is said of the arm's space.
    """

    position: Array
    speed: Array
    acceleration: Array
    torque: Array
    pairs: Pairs | None = None

    @staticmethod
    def of(arm: Arm, *, share: float = 0.8) -> Limits:
        """What the model states, less a margin; torque enough for the fiercest motion where it states none."""
        position, speed, torque = [], [], []
        for joint in arm.joints:
            low, high = joint.limits or ((-1.5, 1.5) if joint.revolute else (-0.2, 0.2))
            middle, half = (low + high) / 2, (high - low) / 2 * share
            # A joint that can turn about need not: half a turn each way shows all that its gravity has to show.
            half = min(half, np.pi / 2) if joint.revolute else half
            position.append([middle - half, middle + half])
            speed.append(share * min(joint.motor_speed_limit / joint.ratio, 3.0) if joint.motor_speed_limit else SPEED)
            torque.append(share * joint.torque_limit if joint.torque_limit else np.inf)
        return Limits(np.array(position), np.array(speed), 4.0 * np.array(speed), np.array(torque))

    def within(
        self,
        arm: Arm,
        *,
        position: Sequence[tuple[float, float]] | None = None,
        speed: Sequence[float] | None = None,
        acceleration: Sequence[float] | None = None,
        current: Sequence[float] | None = None,
        share: float = 0.8,
    ) -> Limits:
        """The narrower of these and of a rig's limits (rad, rad/s, rad/s2, A per joint), less a margin.

        None: the rig states none.
        """
        low, high = self.position.T
        if position is not None:
            lower, upper = np.array(position, float).T
            middle, half = (lower + upper) / 2, (upper - lower) / 2 * share
            low, high = np.maximum(low, middle - half), np.minimum(high, middle + half)
            if (low >= high).any():
                joint = int(np.argmax(low >= high)) + 1
                raise InputError(
                    f"limits.position[{joint}]", f"leave no room within what '{arm.name}' states for the joint"
                )
        slower = self.speed if speed is None else np.minimum(self.speed, share * np.array(speed, float))
        gentler = self.acceleration if acceleration is None else share * np.array(acceleration, float)
        weaker = self.torque
        if current is not None:
            weaker = np.minimum(weaker, share * np.array(current, float) * arm.joint_array("drive_constant"))
        return Limits(np.stack([low, high], axis=1), slower, np.minimum(self.acceleration, gentler), weaker, self.pairs)


@dataclass(frozen=True)
class Series:
    """The finite Fourier series of every joint.

    Duration s (preferably whole periods of the fundamental), fundamental Hz, harmonics.
    """

    duration: float = 20.0
    fundamental: float = 0.1
    harmonics: int = 5


def design_excitation(
    arm: Arm,
    series: Series = Series(),
    *,
    criterion: Criterion = "d",
    limits: Limits | None = None,
    candidates: int = 1600,
    seed: int = 1,
    progress: Progress = lambda _share, _text: None,
) -> Experiment:
    """The best of ``candidates`` motions: random ones first, then steps from the best that shrink when they fail.

    The same seed gives the same motion. ``progress`` is called with the share done and the best score so far, in words.
    InputError where no motion keeps clear of what ``limits.pairs`` names.
    """
    limits = limits or Limits.of(arm)
    base = structural_base(arm)
    random = np.random.default_rng(seed)
    task = _Task(arm, limits, series)
    best, best_score, step = _random(task, random), -np.inf, 0.5
    generations = max(2, candidates // TOGETHER)
    for generation in range(generations):
        if generation < generations // 5:
            trials = [_random(task, random) for _ in range(TOGETHER)]
        else:
            steps = step * random.standard_normal((TOGETHER, *best.shape))
            trials = list(best + steps * (random.random(steps.shape) < 0.3))
        found = [_experiment(task, trial) for trial in trials]
        scores = np.full(len(trials), -np.inf)
        clear = [k for k, one in enumerate(found) if one is not None]
        if clear:
            scores[clear] = excitation_scores(arm, base, [one for one in found if one is not None], limits, criterion)
        winner = int(np.argmax(scores))
        if scores[winner] > best_score:
            best, best_score = trials[winner], float(scores[winner])
            step = min(1.2 * step, 1.0)
        elif generation >= generations // 5:
            step = max(0.9 * step, 0.02)
        progress(generation / generations, f"{criterion} {_shown(best_score, criterion)}")
    return _checked(task, best)


@dataclass(frozen=True)
class _Task:
    """Whose motions are designed: within which limits, of which form."""

    arm: Arm
    limits: Limits
    series: Series


def excitation_scores(
    arm: Arm, base: BaseParameters, experiments: Sequence[Experiment], limits: Limits, criterion: Criterion = "d"
) -> Array:
    """(len(experiments),), larger is better.

    Log determinant of the information, or minus the log of the condition number.
    """
    motions = [_motion(experiment, ROWS) for experiment in experiments]
    t, q, qd, qdd = (np.concatenate([motion[k] for motion in motions]) for k in range(4))
    columns = model_columns(arm, q, qd, qdd, t=t)[:, :, base.kept]
    torque = np.where(np.isfinite(limits.torque), limits.torque, 1.0)
    # In units of what the model expects each parameter to be, so that a condition number means something.
    expected = np.abs(base.grouping @ model_values(arm))
    size = np.maximum(expected, 0.1 * np.median(expected[expected > 0]) if (expected > 0).any() else 1.0)
    rows = (columns / torque[None, :, None] * size).reshape(len(experiments), -1, len(base))
    values = singular_values(rows)
    shown = values[:, -1] > 1e-12 * values[:, 0]
    values = np.maximum(values, 1e-300)
    score = 2 * np.sum(np.log(values), axis=1) if criterion == "d" else -np.log(values[:, 0] / values[:, -1])
    return np.where(shown, score, -np.inf)


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
    return f"{score:.1f}" if criterion == "d" else f"{np.exp(-score):.0f}"


def _random(task: _Task, random: np.random.Generator) -> Array:
    """(n, 1 + 2 harmonics): pose, sines, cosines, in units of the limits; higher harmonics smaller."""
    harmonics = task.series.harmonics
    proposal = random.standard_normal((len(task.arm), 1 + 2 * harmonics))
    proposal[:, 1:] /= np.tile(np.arange(1, harmonics + 1), 2)
    if task.limits.pairs is not None:
        low, high = task.limits.position.T
        quarter = (high - low) / 4
        start = clear_start(task.limits.pairs, low + quarter, high - quarter, random)
        if start is not None:
            proposal[:, 0] = np.arctanh(np.clip((start - (low + high) / 2) / quarter, -0.999, 0.999))
    return np.asarray(proposal)


def _checked(task: _Task, proposal: Array) -> Experiment:
    """The best proposal, clear at every instant; InputError where it is not even clear where it was looked at."""
    share = 1.0
    while (found := _experiment(task, proposal, share)) is not None and share >= SMALLEST:
        if task.limits.pairs is None or is_clear(demand_of(found), task.limits.pairs):
            return found
        share *= 0.95
    assert task.limits.pairs is not None
    low, high = task.limits.position.T
    raise none_is_clear(task.limits.pairs, low + (high - low) / 4, high - (high - low) / 4)


def _experiment(task: _Task, proposal: Array, share: float = 1.0) -> Experiment | None:
    """The proposal scaled into the limits, and to a ``share`` of that; None where it is not clear of the space."""
    arm, limits, series = task.arm, task.limits, task.series
    low, high = limits.position.T
    start = (low + high) / 2 + 0.5 * (high - low) / 2 * np.tanh(proposal[:, 0])
    weights = proposal[:, 1:]
    unit = _fourier(weights, np.zeros(len(arm)), limits, series)
    # sixty a period of the fastest harmonic, fades included
    rows = int(60 * (series.harmonics * series.fundamental * series.duration + 4))
    _, q, qd, qdd = _motion(unit, rows)
    room = np.minimum(
        (high - start) / np.maximum(q.max(axis=0), 1e-9), (start - low) / np.maximum(-q.min(axis=0), 1e-9)
    )
    scale = np.minimum.reduce(
        [
            room,
            limits.speed / np.maximum(np.abs(qd).max(axis=0), 1e-9),
            limits.acceleration / np.maximum(np.abs(qdd).max(axis=0), 1e-9),
        ]
    )
    scale = CLOSE * scale
    q, qd, qdd = q[::4], qd[::4], qdd[::4]
    while True:
        torque = np.abs(inverse_dynamics(arm, start + q * scale, qd * scale, qdd * scale)).max(axis=0)
        over = torque > CLOSE * limits.torque
        if not over.any() or np.max(scale) < 1e-3:
            break
        # Fiercer than the motors: all joints calm down together, since they feel each other.
        scale = scale * 0.85
    if task.limits.pairs is not None:
        scale = scale * clear_share(task.limits.pairs, start, q * scale)
        if not scale.any():
            return None
    scale = scale * share
    return _fourier(weights * scale[:, None], start, limits, series)


def _fourier(weights: Array, start: Array, limits: Limits, series: Series) -> Experiment:
    """weights (n, 2 harmonics) rad: sines, then cosines, about ``start`` (n,) rad."""
    moving = Fourier(
        type="fourier",
        duration=series.duration,
        fundamental=series.fundamental,
        sine=weights[:, : series.harmonics].tolist(),
        cosine=weights[:, series.harmonics :].tolist(),
        fade=min(1.0, series.duration / 4),
    )
    return Experiment(
        name="excitation",
        description="Finite Fourier series, optimised to show the base parameters",
        start=start.tolist(),
        full_speed=limits.speed.tolist(),
        full_acceleration=limits.acceleration.tolist(),
        segment=[Hold(type="hold", duration=0.5), moving, Hold(type="hold", duration=0.5)],
    )


def _motion(experiment: Experiment, rows: int) -> tuple[Array, Array, Array, Array]:
    """t, q, q', q'' of an experiment's demand at ``rows`` instants, derivatives by central differences."""
    demand = demand_of(experiment)
    t = np.linspace(0.0, demand.duration, rows)
    h = 1e-3
    before, here, after = demand(t - h), demand(t), demand(t + h)
    return t, here, (after - before) / (2 * h), (after - 2 * here + before) / h**2
