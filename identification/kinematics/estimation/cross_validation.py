"""Which extensions improve the held-out error: cross-validation on blocks of points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.extensions import Extension, prior_scales
from identification.kinematics.estimation.map_estimation import LEAST_NOISE, Fit, fit
from identification.kinematics.estimation.observed import linear_in
from identification.kinematics.models.chain import Index
from identification.kinematics.models.parameters import Parameters
from identification.selection.limits import Limits
from identification.selection.stepwise import MeasurementModel, Score, select


@dataclass(frozen=True, kw_only=True)
class ExtensionLimits(Limits):
    """Gains are shares of the rms.

    standard_errors  between blocks that a gain must exceed, in place of a false-discovery rate: there are enough blocks
    likely           the same, of an extension in a set that is tried instead of the one found
    folds            parts of the points, each predicted without itself
    """

    standard_errors: float = 3.0
    likely: float = 2.0
    folds: int = 5


LIMITS = ExtensionLimits(
    max_causes=30,
    fdr=None,
    # less is not worth a parameter
    min_gain=0.02,
    kept_gain=None,
)

_EQUAL = 1e-5
"""Relative difference of errors within which the candidate that the catalogue has first is taken."""
_ALIASED = 0.95
"""Share of the best candidate's gain that makes another one indistinguishable."""


@dataclass(frozen=True)
class Trial:
    """One extension conditional on those accepted so far.

    Rms m per coordinate of left-out points ``before`` and ``after``; z: its gain over the standard error between
    blocks; alike: other candidates that explain nearly the same, so that these points do not decide between them.
    """

    extension: Extension
    before: float
    after: float
    z: float
    accepted: bool
    alike: tuple[Extension, ...] = ()


def choose(
    parameters: Parameters,
    points: Points,
    blocks: Index,
    candidates: Sequence[Extension],
    deflect: Callable[[Sequence[Extension]], Array],
    start: Fit,
    report: Callable[[str], None] | None = None,
) -> tuple[list[Extension], list[Trial]]:
    """Extensions accepted one after the other, the best first, and the trials of every round's best.

    The best of a round may be a mixture of two others (sag and eccentricity of joint 2 for errors of joint 3), after
    which neither is significant. So the selection is repeated without each extension accepted; where that leaves less
    on unseen points, by the gain asked of any extension, it is taken, and the extension may enter after it.

    Points are cut into blocks (N,) of neighbours; whole blocks are left out in turn, so that no point is predicted from
    its own neighbours. A candidate is accepted if its gain on left-out blocks exceeds the ``LIMITS``. All of it on the
    linearised problem, which after the fit is exact to a micrometre.

    deflect gives the deflections (N, joints, parameters) of extensions at ``points``.
    """
    thin = np.flatnonzero(start.inlier)
    thin = thin[:: max(1, len(thin) // 6000)]
    model = LeftOutPoints(
        parameters=parameters,
        points=points.where(thin),
        blocks=np.unique(blocks[thin], return_inverse=True)[1],
        fold=_folds(blocks[thin], LIMITS.folds),
        candidates=tuple(candidates),
        deflect=lambda extensions: deflect(extensions)[thin],
        nominal=start.values,
        report=report or (lambda sentence: None),
    )
    found = _selection(model)
    while found.chosen:
        best = min(
            (other for one in found.chosen for other in _without(one, found, model)), key=lambda other: other.cost
        )
        if best.cost >= (1.0 - _EQUAL) * found.cost:
            break
        again = _selection(replace(model, begin=best.chosen, trials=[trial for trial in best.trials if trial.accepted]))
        # what was left out may enter again: on points without noise the search would not end
        if again.cost >= found.cost:
            break
        found = again
    return list(found.chosen), found.trials


Chosen = tuple[Extension, ...]


@dataclass(frozen=True, kw_only=True)
class LeftOutPoints(MeasurementModel[Extension, Chosen]):
    """Tracked points as a measurement model of the selection, each predicted without its fold.

    blocks, fold  (N,) number of every point's block and fold, from 0
    deflect       (N, joints, parameters) of extensions at the points
    nominal       values of the chain at which fits start
    """

    parameters: Parameters
    points: Points
    blocks: Index
    fold: Index
    candidates: Chosen
    deflect: Callable[[Sequence[Extension]], Array]
    nominal: Array
    report: Callable[[str], None]
    limits: ExtensionLimits = LIMITS
    begin: Chosen = ()
    trials: list[Trial] = field(default_factory=list)

    def start(self) -> Chosen:
        """The extensions from which the selection begins."""
        return self.begin

    def chosen(self, state: Chosen) -> Chosen:
        """The extensions of a state."""
        return state

    def scores(self, state: Chosen) -> list[Score[Extension]]:
        """The candidate that leaves least alone: where it is not significant, none enters."""
        scores = self._scores([c for c in self.candidates if c not in state], state)
        if not scores:
            return []
        least = min(trial.after for _, trial in scores)
        equal = [one for one in scores if one[1].after <= least * (1.0 + _EQUAL)]
        best, trial = equal[0]
        alike = [t.extension for s, t in scores if s is not best and s.gain >= _ALIASED * best.gain]
        trial = replace(trial, alike=tuple(alike))
        self.trials.append(trial)
        self.report(f"{trial.extension}: {1e3 * trial.before:.4f} -> {1e3 * trial.after:.4f} mm on unseen points")
        return [best]

    def admissible(self, score: Score[Extension], state: Chosen) -> bool:
        """Whether the trial of this round was accepted."""
        return self.trials[-1].accepted

    def entered(self, score: Score[Extension], admissible: Sequence[Score[Extension]], state: Chosen) -> Chosen:
        """With the extension."""
        return (*state, score.candidate)

    def without(self, candidate: Extension, state: Chosen) -> Chosen:
        """Without the extension."""
        return tuple(c for c in state if c is not candidate)

    def conditional(self, candidate: Extension, without: Chosen, state: Chosen) -> Score[Extension]:
        """One extension conditional on all others."""
        return self._scores([candidate], without)[0][0]

    def needed(self, score: Score[Extension], state: Chosen) -> bool:
        """Whether an extension still reduces the error."""
        return score.gain > 0.0

    def _scores(self, candidates: Sequence[Extension], state: Chosen) -> list[tuple[Score[Extension], Trial]]:
        part = self.points
        bend = self.deflect(state) if state else None
        now = fit(
            self.parameters,
            part.deflected(bend),
            start=self.nominal,
            extension_scale=prior_scales(state),
        )
        linear = _linear(self.parameters, part, bend, now)
        normals = _normals(linear, self.fold)
        before = _left_out(linear, normals, np.zeros((len(part), 3, 0)), np.zeros(0))
        scores = []
        for extension in candidates:
            columns = linear.joint @ self.deflect([extension])
            after = _left_out(linear, normals, columns, np.array(extension.scales))
            scores.append(_judged(extension, before, after, self.blocks, self.limits))
        return scores


@dataclass(frozen=True)
class _Selection:
    """Extensions chosen, the trials that led to them, and the rms (m per coordinate) that they leave unseen."""

    chosen: Chosen
    trials: list[Trial]
    left: float

    @property
    def cost(self) -> float:
        """The rms left, larger by the least gain of an extension for each of them."""
        return self.left / (1.0 - LIMITS.min_gain) ** len(self.chosen)


def _without(one: Extension, found: _Selection, model: LeftOutPoints) -> Iterator[_Selection]:
    """The selection without an extension and those of its joint that are alike.

    From the beginning, and from the others that were chosen. The set that is found counts as a whole, so each of it has
    to be but likely.
    """
    kept = [trial for trial in found.trials if trial.accepted and trial.extension is not one]
    alike = [
        other for trial in found.trials if trial.extension is one for other in trial.alike if other.joint == one.joint
    ]
    rest = tuple(c for c in model.candidates if c is not one and c not in alike)
    limits = replace(model.limits, standard_errors=model.limits.likely)
    for begin, trials in (((), []), (tuple(c for c in found.chosen if c is not one), kept)):
        yield _selection(replace(model, candidates=rest, begin=begin, trials=trials, limits=limits))


def _selection(model: LeftOutPoints) -> _Selection:
    """What the stepwise selection chooses among the candidates of a model."""
    known = len(model.trials)
    chosen: Chosen = select(model)
    last = model.trials[-1] if len(model.trials) > known else None
    left = np.inf if last is None else last.after if last.accepted else last.before
    return _Selection(chosen, model.trials, float(left))


@dataclass(frozen=True)
class _Linear:
    """The problem linearised about an estimate: residual (N, 3) and columns per prior deviation (N, 3, p).

    Also the estimate u0 (p,) itself, and the derivative dp/dq (N, 3, joints).
    """

    residual: Array
    columns: Array
    at: Array
    joint: Array
    noise: float


def _linear(parameters: Parameters, points: Points, bend: Array | None, estimate: Fit) -> _Linear:
    chain = parameters.chain.at(estimate.values)
    residual, every = linear_in(chain, points.deflected(bend), estimate.extension)
    joint = every[:, :, chain.joint_steps()]
    free, scale = parameters.free, parameters.scale[parameters.free]
    columns = every[:, :, free] * scale
    where = (estimate.values - parameters.chain.values)[free] / scale
    if bend is not None and len(estimate.extension):
        deviation = np.sqrt(np.diag(estimate.covariance))[len(free) :]
        spread = np.maximum(10.0 * deviation, np.abs(estimate.extension))  # free to move: it is already found
        columns = np.concatenate((columns, (joint @ bend) * spread), axis=2)
        where = np.concatenate((where, np.zeros(len(spread))))
    return _Linear(residual, columns, where, joint, estimate.noise)


@dataclass(frozen=True)
class _Normal:
    """Normal equations of one fold: the points in it, and H = A'A, g = A'r in units of the noise."""

    rows: Index
    flat: Array
    residual: Array
    hessian: Array
    gradient: Array


def _normals(linear: _Linear, fold: Index) -> list[_Normal]:
    out = []
    for k in np.unique(fold):
        rows = np.flatnonzero(fold == k)
        flat = linear.columns[rows].reshape(-1, linear.columns.shape[2]) / linear.noise
        residual = linear.residual[rows].ravel() / linear.noise
        out.append(_Normal(rows, flat, residual, flat.T @ flat, flat.T @ residual))
    return out


def _left_out(linear: _Linear, folds: Sequence[_Normal], extra: Array, scales: Array) -> Array:
    """Squared residual length (N,) of every point, each predicted without its fold: one linear solution a fold.

    extra (N, 3, k) are columns of an extension on top; the blocks of the normal equations without them are given.
    """
    added = [(extra[f.rows] * (scales / linear.noise)).reshape(3 * len(f.rows), len(scales)) for f in folds]
    hessians = [
        np.block([[f.hessian, f.flat.T @ e], [e.T @ f.flat, e.T @ e]]) for f, e in zip(folds, added, strict=True)
    ]
    gradients = [np.concatenate((f.gradient, e.T @ f.residual)) for f, e in zip(folds, added, strict=True)]
    prior = np.concatenate((linear.at, np.zeros(len(scales))))
    hessian, gradient = sum(hessians) + np.eye(len(prior)), sum(gradients) - prior
    squares = np.empty(len(linear.residual))
    for f, e, h, g in zip(folds, added, hessians, gradients, strict=True):
        step = np.linalg.solve(hessian - h, gradient - g)
        left = (f.residual - f.flat @ step[: len(linear.at)] - e @ step[len(linear.at) :]) * linear.noise
        squares[f.rows] = np.sum(left.reshape(-1, 3) ** 2, axis=1)
    return squares


def _folds(blocks: Index, folds: int) -> Index:
    names, index = np.unique(blocks, return_inverse=True)
    order = np.random.default_rng(1).permutation(len(names))
    return (order % min(folds, max(2, len(names))))[index]


def _judged(
    extension: Extension, before: Array, after: Array, blocks: Index, limits: ExtensionLimits
) -> tuple[Score[Extension], Trial]:
    gains = np.bincount(blocks, before - after).astype(float)
    gain = float(gains.sum())
    error = float(np.sqrt(np.sum((gains - gains.mean()) ** 2) * len(gains) / max(len(gains) - 1, 1)))
    z = gain / max(error, 1e-300)
    rms_before, rms_after = (float(np.sqrt(np.mean(s) / 3.0)) for s in (before, after))
    matters = rms_after < (1.0 - limits.min_gain) * rms_before and rms_before**2 - rms_after**2 > LEAST_NOISE**2
    accepted = bool(z > limits.standard_errors and matters)
    score = Score(
        candidate=extension,
        gain=gain,
        # significance is that of z, by the error between blocks
        p=0.0,
        blocks=gains,
        coefficients=np.zeros(len(extension.scales)),
    )
    return score, Trial(extension, rms_before, rms_after, z, accepted)
