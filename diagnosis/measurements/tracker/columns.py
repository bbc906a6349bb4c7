"""Candidates of the tracked points, their columns, and the fit of several together.

Geometric errors change values of the kinematic chain (``identification.kinematics``); every other effect turns the
joints by its own law from ``arm_model.effects``, per unit of its linear parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Effect, Instrument, Parameter, Signals, Values, described, observed_by, units
from arm_model.effects.description_errors import JOINT_ZERO_OFFSET
from arm_model.effects.tracking import LINK_GEOMETRY
from diagnosis.measurements.tracker.points import Side
from diagnosis.selection.candidate import Candidate
from identification.kinematics.data import Points, correlation_time
from identification.kinematics.estimation import Fit, fit, residuals
from identification.kinematics.models import Parameters, chain_of, parallel_next

GEOMETRY = {p.name: p.chain for p in LINK_GEOMETRY.parameters}
"""Value of the kinematic chain that each geometric error of a link moves."""
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


@dataclass(frozen=True)
class TrackedCandidate(Candidate):
    """A candidate for the tracker's points.

    ``names``: the geometric errors that are free; ``shape``: nonlinear parameters, such as the order of a ripple.
    """

    names: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.names) if self.names else 2 if self.shape else 1

    @property
    def scales(self) -> Array:
        """(k,) prior std of its coefficients."""
        if self.names:
            return np.array([LINK_GEOMETRY[name].tracker_prior for name in self.names])
        return np.full(self.size, self.parameter.tracker_prior)

    @property
    def parameter(self) -> Parameter:
        """The parameter whose coefficient, or reciprocal, the points show."""
        if self.definition is JOINT_ZERO_OFFSET:
            return LINK_GEOMETRY["d_theta"]
        return next(p for p in self.definition.parameters if p.tracker_prior is not None)

    @property
    def values(self) -> tuple[str, ...]:
        """Names of the chain's values that it frees."""
        return tuple(f"joint{self.joint}.{GEOMETRY[name]}" for name in self.names)

    def parameters(self, coefficients: Sequence[float]) -> dict[str, float]:
        """As ``Candidate.parameters``.

        A geometric error is its coefficient, an inverse parameter the reciprocal of it.
        """
        if self.definition is JOINT_ZERO_OFFSET:
            # theta of the chain has the opposite sign of the zero's error
            return {self.definition.linear[0].name: -coefficients[0]}
        if self.names:
            return dict(zip(self.names, coefficients))
        if self.parameter.inverse:
            return {self.parameter.name: 1.0 / coefficients[0] if coefficients[0] else np.inf}
        if self.unit_amplitude:
            # a gap acts nonlinearly on currents, but linearly on points
            return {self.parameter.name: coefficients[0]}
        return super().parameters(coefficients)


def candidates(arm: Arm) -> Iterator[TrackedCandidate]:
    """Every candidate for this arm; the simplest first."""
    laws = [effect for effect in observed_by(Instrument.TRACKER) if effect.change is None and effect.stray is None]
    yield from (TrackedCandidate(effect.name, None) for effect in laws if effect.late is not None)
    for j, joint in enumerate(arm.joints, 1):
        alone = np.array_equal(arm.coupling_matrix[:, j - 1], np.eye(len(arm))[j - 1])
        names = () if not alone else ("d_theta",) if joint.revolute else ("d_d",)
        yield TrackedCandidate(JOINT_ZERO_OFFSET.name, j, names=names)
    for j, joint in enumerate(arm.joints, 1):
        if joint.revolute:
            for effect in sorted(laws, key=lambda effect: len(effect.parameters)):
                if effect.per_joint:
                    yield from (TrackedCandidate(effect.name, j, shape) for shape in _orders(effect))
    parallel = parallel_next(described(arm))
    for j in range(1, len(arm) + 1):
        if parallel[j - 1]:
            yield TrackedCandidate(LINK_GEOMETRY.name, j, names=tuple(GEOMETRY))
        else:
            # beta is nearly aliased there with this theta and the next: it is a candidate of its own
            yield TrackedCandidate(LINK_GEOMETRY.name, j, names=tuple(name for name in GEOMETRY if name != "beta"))
            yield TrackedCandidate(LINK_GEOMETRY.name, j, names=("beta",))


def _orders(effect: Effect) -> Iterator[tuple[tuple[str, float], ...]]:
    """Nonlinear parameters that are tried: the orders of a wave, of all others none."""
    waves = [(p.name, order) for p in effect.parameters if p.whole for order in p.search] if effect.wave else []
    yield from (((name, float(order)),) for name, order in waves)
    if not waves:
        yield ()


def turns(candidate: TrackedCandidate, side: Side) -> Array:
    """(N, n, k) rad: turn of each joint by a unit of each coefficient; k = 0 for geometry."""
    n, j = side.q.shape[1], (candidate.joint or 1) - 1
    if candidate.names:
        return np.zeros((len(side), n, 0))
    effect = candidate.definition
    if effect is JOINT_ZERO_OFFSET:  # of a joint that moves several links; the sign is that of d_theta
        return np.tile(side.coupling[:, j : j + 1], (len(side), 1, 1))
    # an inverse parameter at 1: its coefficient is the reciprocal
    values = {p.name: 1.0 if p.inverse else 0.0 for p in effect.parameters} | dict(candidate.shape)
    unit_values = units(effect, values)
    if effect.late is not None:
        return -float(effect.late(unit_values[0], Signals())) * side.v[..., None]
    signals = Signals(q=side.q[:, j], motor=side.motor[:, j], load=side.load[:, j])
    columns = []
    if effect.bend is not None:
        columns = [effect.bend(unit, replace(signals, load=side.holding[:, j])) for unit in unit_values]
    elif effect.angle is not None:  # link angle = reading - error
        columns = [-effect.angle(unit, signals) for unit in unit_values]
    elif effect.deflection is not None:
        columns = [-effect.deflection(unit, signals) for unit in unit_values]
    # sag of a link rotates this link alone; effects between motor and link rotate all links that the motor moves
    moved = np.eye(n)[j] if effect.bend is not None else side.coupling[:, j]
    return np.asarray(np.column_stack(columns)[:, None, :] * moved[:, None])


def is_of_encoder(candidate: TrackedCandidate) -> bool:
    """Whether a candidate is a wave of a motor's encoder."""
    return not candidate.names and candidate.definition.wave and candidate.definition.angle is not None


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


def is_physical(candidate: TrackedCandidate, coefficients: Array) -> bool:
    """Whether a compliance or a gap is positive, and a gap not wider than gears have."""
    if candidate.names or candidate.shape or candidate.definition is JOINT_ZERO_OFFSET:
        return True
    return candidate.definition.admits(candidate.parameter.name, float(coefficients[0])) and coefficients[0] != 0.0
