"""Candidates fitted to tracked points together, with the frame of the tracker and its target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Signals, Values, described
from diagnosis.measurements.tracker.candidates import TrackedCandidate, is_of_encoder, turns, yields
from diagnosis.measurements.tracker.points import Side
from identification.kinematics.data import Points, correlation_time
from identification.kinematics.estimation import Fit, fit, residuals
from identification.kinematics.models import Parameters, chain_of

FRAME = 3e-4
"""m, rad: prior std of the tracker's frame from a rig file."""
TARGET = 3e-4
"""m: prior std of the target's position from a rig file."""
ANYWHERE = 10.0
"""Prior std of the frame of a tracker whose pose, or of a target whose position, no rig file gives."""
BY_CHANCE = 0.01
"""Probability by which, with nothing wrong, the points deny what a model says of its geometry in any direction."""
INFORMATIVE = 0.5
"""Of the prior variance: what points must leave of it at most to say something of a direction."""
ROUNDS = 10
"""Of the angle that reads with its wave as measured: the largest wave turns by half of its own argument at most."""
BOUND = 2.5
"""Prior std beyond which frame and target are kept at their values: the error has another cause."""


@dataclass(frozen=True)
class Survey:
    """Frame and target of the tracker as the rig files of recordings state them.

    target (3,) m in the frame of the last link, its origin where it is not known; frame_known: whether the points are
    in the frame of the arm's base.
    """

    target: tuple[float, float, float]
    target_known: bool
    frame_known: bool


def at_motors(state: State, arm: Arm, side: Side) -> Side:
    """A side with the angles of motors as they are without the chosen waves of their encoders."""
    motor = side.motor.copy()
    for candidate in filter(is_of_encoder, state.chosen):
        wave, j = candidate.definition.angle, (candidate.joint or 1) - 1
        assert wave is not None
        values = Values(candidate.parameters(state.coefficients(candidate)[0].tolist()))
        for _ in range(ROUNDS):
            motor[:, j] = side.motor[:, j] - arm.joints[j].ratio * wave(values, Signals(motor=motor[:, j]))
    return replace(side, motor=motor)


def at_links(state: State, side: Side) -> Side:
    """A side with the torques of links where the chosen springs and gaps let them be: their weight depends on that.

    By a spring of stiffness k that carries a weight whose torque changes by w per rad, a load at the angles that are
    read is wrong by w / k of itself.
    """
    bent = [c for c in state.chosen if yields(c)]
    return side.turned(sum((turns(c, side) @ state.coefficients(c)[0] for c in bent), np.zeros_like(side.q)))


@dataclass(frozen=True)
class State:
    """Candidates fitted together, with frame and target: the fit, and the parameters that were free.

    correlated: how many neighbouring points count as one in the deviations.
    """

    chosen: tuple[TrackedCandidate, ...]
    parameters: Parameters
    estimate: Fit
    correlated: float = 1.0

    @property
    def values(self) -> Array:
        """(steps,) of every step of the chain, as fitted; m or rad."""
        return self.estimate.values

    def points(self, side: Side) -> Points:
        """The points of a side with the deflections of the chosen candidates."""
        return points_of(self.chosen, side)

    def coefficients(self, candidate: TrackedCandidate) -> tuple[Array, Array]:
        """(k,) and their covariance (k, k), as fitted."""
        chain, free = self.parameters.chain, list(self.parameters.free)
        if candidate.names:
            where = [chain.names.index(name) for name in candidate.values]
            rows = [free.index(k) for k in where]
            coefficients = (self.estimate.values - chain.values)[where]
        else:
            bent = [c for c in self.chosen if not c.names]
            before = sum(c.size for c in bent[: bent.index(candidate)])
            rows = [len(free) + before + k for k in range(candidate.size)]
            coefficients = self.estimate.extension[before : before + candidate.size]
        return coefficients, self.estimate.covariance[np.ix_(rows, rows)]


def points_of(chosen: Sequence[TrackedCandidate], side: Side) -> Points:
    """The side's points with the turns of all chosen candidates."""
    bent = [turns(c, side) for c in chosen if not c.names]
    return Points(side.q, side.xyz, np.concatenate(bent, axis=2) if bent else None)


def fitted(
    arm: Arm,
    chosen: Sequence[TrackedCandidate],
    side: Side,
    survey: Survey,
    *,
    start: Array | None = None,
    steps: Array | None = None,
) -> State:
    """All chosen candidates fitted together with frame and target.

    Values of frame and target that would exceed BOUND prior std are kept at those of the rig.

    steps (n,) rad: of encoders whose zeros may be wrong by up to a count in every recording; these are then fitted as
    well, so that values and std are those of many recordings.
    """
    parameters = _parameters(arm, chosen, survey)
    scale = np.concatenate([np.zeros(0), *(c.scales for c in chosen if not c.names)])
    points, terms = points_of(chosen, side), len(scale)
    if steps is not None:
        of_zeros = np.tile(zero_scales(steps), len(np.unique(side.of)))
        points, scale = _with_zeros(points, side), np.concatenate((scale, of_zeros))
    values = parameters.chain.values if start is None else start
    estimate = fit(parameters, points, start=values, extension_scale=scale)
    for _ in range(3):
        free, nominal = parameters.free, parameters.chain.values
        off = (estimate.values - nominal)[free] / parameters.scale[free]
        ours = np.array([parameters.chain.names[k].startswith(("base.", "target.")) for k in free], bool)
        beyond = ours & (np.abs(off) > BOUND) & (parameters.scale[free] < 1.0)
        if not beyond.any():
            break
        parameters = replace(parameters, free=free[~beyond])
        estimate = fit(parameters, points, extension_scale=scale)
    if parameters.correlation is not None and (held := _beyond_known(parameters, estimate)).shape[1]:
        parameters = replace(parameters, held=held)
        estimate = fit(parameters, points, start=values, extension_scale=scale)
    covariance, correlated = estimate.covariance, 1.0
    if steps is not None:
        correlated = _correlated(residuals(parameters, estimate.values, estimate.extension, points), estimate, side)
        prior = np.concatenate((parameters.scale[parameters.free], scale))
        root = prior[:, None] * parameters.prior_root(len(scale))
        covariance = _widened(covariance, root, correlated)
    count = len(parameters.free) + terms
    trimmed = replace(estimate, extension=estimate.extension[:terms], covariance=covariance[:count, :count])
    return State(tuple(chosen), parameters, trimmed, correlated)


def _beyond_known(parameters: Parameters, estimate: Fit) -> Array:
    """(free, h) directions, in units of the prior, in which the points contradict the model's stated uncertainty.

    The directions are those in which the points determine the parameters one by one. With nothing wrong, the estimate
    in units of the prior has a variance of 1 less that of the estimate itself.
    """
    count = len(parameters.free)
    inverse = np.linalg.inv(parameters.prior_root()) / parameters.scale[parameters.free]
    unit = inverse @ (estimate.values - parameters.chain.values)[parameters.free]
    eigenvalues, axes = np.linalg.eigh(inverse @ estimate.covariance[:count, :count] @ inverse.T)
    seen = eigenvalues < INFORMATIVE
    off = np.abs(axes[:, seen].T @ unit) / np.sqrt(1.0 - eigenvalues[seen])
    return np.asarray(axes[:, seen][:, off > stats.norm.isf(BY_CHANCE / 2 / max(count, 1))])


def _correlated(residual: Array, estimate: Fit, side: Side) -> float:
    """How many neighbouring points count as one."""
    rows = [np.flatnonzero(side.of == k) for k in np.unique(side.of)]
    return correlation_time(np.where(estimate.inlier[:, None], residual, 0.0), rows)


def _widened(covariance: Array, root: Array, correlated: float) -> Array:
    """The covariance if only every ``correlated``-th point counts, with the same prior root root^T."""
    one, inverse = np.eye(root.shape[1]), np.linalg.pinv(root)
    unit = inverse @ covariance @ inverse.T  # (H + 1)^-1 for points that say H
    information = np.linalg.inv(unit) - one
    return np.asarray(root @ np.linalg.inv(information / correlated + one) @ root.T)


def _with_zeros(points: Points, side: Side) -> Points:
    """The points with a free zero for every joint in every recording."""
    n, runs = side.q.shape[1], np.unique(side.of)
    columns = np.zeros((len(side), n, len(runs) * n))
    for k, run in enumerate(runs):
        columns[side.of == run, :, k * n : (k + 1) * n] = side.coupling
    bent = points.deflections
    return Points(points.q, points.xyz, columns if bent is None else np.concatenate((bent, columns), axis=2))


def zero_scales(steps: Array) -> Array:
    """(n,) prior std of encoder zeros, rad; steps (n,) rad of the encoders.

    It has two parts of step / sqrt(12): the count to which a counter is preset, and the position within this count.
    """
    return np.asarray(np.maximum(steps, 1e-7) / np.sqrt(6.0))


def _parameters(arm: Arm, chosen: Sequence[TrackedCandidate], survey: Survey) -> Parameters:
    chain = chain_of(described(arm), survey.target)
    prior_std = {name: float(scale) for c in chosen if c.names for name, scale in zip(c.values, c.scales)}
    scale = np.zeros(len(chain.steps))
    for k, step in enumerate(chain.steps):
        group = step.name.partition(".")[0]
        if group == "base":
            scale[k] = FRAME if survey.frame_known else ANYWHERE
        elif group == "target":
            scale[k] = TARGET if survey.target_known else ANYWHERE
        elif step.name in prior_std:
            scale[k] = prior_std[step.name]
    return _with_known(Parameters(chain, np.flatnonzero(scale), np.flatnonzero(scale), scale), arm)


def _with_known(parameters: Parameters, arm: Arm) -> Parameters:
    """Also what is known of the arm's geometry is free, within its covariance: beside it, candidates are errors."""
    uncertainty, scale = arm.kinematic_uncertainty, parameters.scale
    if uncertainty is None or not uncertainty.parameters:
        return parameters
    where = [parameters.chain.names.index(name) for name in uncertainty.parameters]
    covariance = np.diag(scale**2)
    covariance[np.ix_(where, where)] += uncertainty.matrix
    wider = np.sqrt(np.diag(covariance))
    over = np.where(wider > 0.0, wider, 1.0)
    correlation, free = covariance / np.outer(over, over), np.flatnonzero(wider)
    correlation[np.diag_indices(len(wider))] = 1.0
    return replace(parameters, free=free, every=free, scale=wider, correlation=correlation)
