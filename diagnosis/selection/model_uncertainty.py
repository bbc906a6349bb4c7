"""Whether an effect is beyond what is known of the model: its significance with the parameters of the model free.

A model that was identified is known to a covariance (``arm_model.tables.uncertainty``). Its parameters are nuisances
with a Gaussian prior: whitened residuals are

    y = A a + X c + L u + e,    u ~ N(0, 1),

with columns A of the other causes, X of the effect, and L = (columns of the parameters) (root of their covariance): one
column per independent error, in units of one standard deviation. a, c and u are fitted together, u against its prior
(generalised least squares written as a regression with further rows u = 0; Theil & Goldberger, Int. Economic Review 2,
1961). c is significant if it differs from zero by more than its covariance allows (Wald, F distribution). That
covariance has three parts: e, clustered by block (Liang & Zeger, 1986); the prior of u; and what the model left over on
the recordings that it was identified from, of which any one effect may explain ``LOOKS_ALIKE``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg, stats

from arm_io.types import Array
from arm_model import Arm, parameter, with_parameters
from arm_model.effects import described
from arm_model.rigid_body.regressor import regressor
from arm_model.system import inverse_dynamics
from diagnosis.residual.run import ROWS_FOR_ONE, Run
from diagnosis.selection.design import Dataset, Pair
from diagnosis.selection.regression import INDEPENDENT
from identification.selection import Split

SUREST = 1e-300
"""Probability below which numbers end."""
LOOKS_ALIKE = 0.1
"""Share of what a model left over that any one effect may explain, though nothing changed."""


@dataclass(frozen=True)
class ModelUncertainty:
    """Of an identified model, in the whitened residuals of some recordings.

    directions  (N, r), (M, r): change of the residual for one standard deviation of each independent error
    left_over   (n,) squared residual per row, in units of the noise, that the model left when it was identified
    """

    directions: Split[Array]
    left_over: Array

    def share(self, data: Dataset) -> Array:
        """(n,) squared residual per row that the uncertainty of the parameters makes in fitted or held-out rows."""
        own = self.directions.fit if len(self.directions.fit) == len(data.y) else self.directions.held_out
        return data.by_joint(np.sum(own**2, axis=1)) / data.rows


def in_deviations(chance: float) -> float:
    """Standard deviations of a normal quantity that is as far from zero with this probability."""
    return float(stats.norm.isf(max(chance, SUREST) / 2))


def model_uncertainty(arm: Arm, data: Split[Dataset]) -> ModelUncertainty | None:
    """What is known of an arm, as these recordings feel it; None where nothing is stated."""
    known = arm.uncertainty
    if known is None or not (known.parameters or any(known.left_over)):
        return None
    root = known.directions

    def felt(side: Dataset) -> Array:
        runs = [run.whiten(_columns(run, known.parameters) @ root) for run in side.runs]
        return np.concatenate(runs).transpose(1, 0, 2).reshape(-1, root.shape[1])

    return ModelUncertainty(data.map(felt), _left_over(known.left_over, data))


def _left_over(left_over: Sequence[float], data: Split[Dataset]) -> Array:
    runs = [run for side in data for run in side.runs]
    constant = runs[0].arm.joint_array("drive_constant")
    over = np.concatenate([1.0 / run.instruments**2 for run in runs]).mean(axis=0)
    return np.asarray((np.array(left_over or [0.0] * len(constant)) / constant) ** 2 * over)


def _columns(run: Run, names: Sequence[str]) -> Array:
    """(m, n, p) A: change of the expected currents for a unit of each parameter of the model."""
    bent = described(run.arm)
    slow, every = regressor(bent, run.q, run.v, run.a)
    brisk, _ = regressor(bent, run.q, run.brisk_v, run.a)
    place = {name: k for k, name in enumerate(every)}
    columns = np.empty((*run.q.shape, len(names)))
    for k, name in enumerate(names):
        own = [place[one] for one in (name, f"{name}_positive", f"{name}_negative") if one in place]
        if own:
            # friction follows the speed in the band of comparison
            from_motion = slow if name.startswith("link") or name.endswith(".rotor_inertia") else brisk
            columns[..., k] = from_motion[..., own].sum(axis=-1)
        else:
            columns[..., k] = _slope(run, name)
    return columns * run.powered / bent.joint_array("drive_constant")[:, None]


def _slope(run: Run, name: str) -> Array:
    """(m, n) N m: of a parameter that is no column of the regressor, by a finite difference."""
    step = 1e-4
    moved = with_parameters(run.arm, {name: parameter(run.arm, name) + step})
    before, after = (inverse_dynamics(arm, run.q, run.v, run.a) for arm in (run.arm, moved))
    return np.asarray((after - before) / step)


class Significance:
    """Of columns conditional on others, with the model exact or (``known``) as uncertain as it is.

    Rows of a joint count less, the more the model left over there: they are in units of the noise and that together.
    """

    def __init__(self, data: Split[Dataset], others: Sequence[Pair], known: ModelUncertainty | None) -> None:
        self._data, self._others, self._known = data, others, known
        self._own = sum(pair.fit.x.shape[1] for pair in others)

    @cached_property
    def _weight(self) -> Array:
        """(N + M,) of every row."""
        left = np.zeros(len(self._data.fit.y) // self._data.fit.rows) if self._known is None else self._known.left_over
        return np.concatenate([np.repeat(1.0 / np.sqrt(1.0 + left), side.rows) for side in self._data])

    def _stack(self, pair: Pair) -> Array:
        """(N + M, k) weighted columns in both sets."""
        both = [columns.dense(len(side.y)) for columns, side in zip(pair, self._data)]
        return np.concatenate(both) * self._weight[:, None]

    @cached_property
    def _beside(self) -> Array:
        """(N + M, b) columns of all others: of effects, then of the model."""
        parts = [np.zeros((len(self._weight), 0)), *map(self._stack, self._others)]
        if self._known is not None:
            parts.append(np.concatenate(list(self._known.directions)) * self._weight[:, None])
        return np.hstack(parts)

    @cached_property
    def _inverse(self) -> Array:
        """(b, b) inverse of the normal matrix of all others, with the prior of the model's parameters."""
        gram = self._beside.T @ self._beside
        gram[np.diag_indices(len(gram))] += np.arange(len(gram)) >= self._own
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        return np.asarray(linalg.pinvh(gram / np.outer(scale, scale), rtol=1e-9) / np.outer(scale, scale))

    @cached_property
    def _y(self) -> Array:
        """(N + M,) weighted residuals."""
        return np.concatenate([side.y for side in self._data]) * self._weight

    @cached_property
    def _residual(self) -> Array:
        """(N + M,) what is left of them with all others fitted."""
        return np.asarray(self._y - self._beside @ (self._inverse @ (self._beside.T @ self._y)))

    @cached_property
    def _blocks(self) -> Array:
        """(N + M,) number of the block of every row."""
        fit, held_out = self._data
        return np.concatenate([fit.block, held_out.block + int(fit.block.max()) + 1])

    def beyond_model(self, pair: Pair, level: float) -> bool:
        """Whether columns are significant at a level with the parameters of the model free; always with it exact."""
        return self._known is None or self.chance(pair) < level

    def allowed(self, side: Dataset, joint: int) -> float:
        """How many times the noise a residual of a joint (from 1) is with nothing wrong: 1 where the model is exact."""
        if self._known is None:
            return 1.0
        return float(np.sqrt(1.0 + self._known.left_over[joint - 1] + self._known.share(side)[joint - 1]))

    def chance(self, pair: Pair) -> float:
        """Probability that columns (k of them) look as they do without the effect that they are of."""
        x = self._stack(pair)
        along = self._inverse @ (self._beside.T @ x)
        own = x - self._beside @ along
        gram, size = own.T @ x, np.sqrt(np.maximum(np.sum(x**2, axis=0), 1e-300))
        values, vectors = np.linalg.eigh((gram + gram.T) / 2 / np.outer(size, size))
        seen = values > INDEPENDENT**2
        if not seen.any():
            return 1.0
        # coefficients along independent combinations of the columns, each of unit length beside the others
        turn = vectors[:, seen] / np.sqrt(values[seen]) / size[:, None]
        own, along = own @ turn, along[self._own :] @ turn
        # beside the rows u = 0 of the prior, too, the columns are perpendicular to all others
        c = own.T @ self._y
        freedom = max(int(self._blocks.max()) + 1 - len(c), 1)
        covariance = self._of_noise(own, c) + along.T @ along + self._of_left_over(own)
        wald = float(c @ linalg.pinvh(covariance) @ c)
        return float(stats.f.sf(wald / len(c), len(c), freedom))

    def _of_noise(self, own: Array, c: Array) -> Array:
        """(k, k) covariance of the coefficients c (k,) of columns ``own`` by the residual.

        Clustered by block, and as if it were alike everywhere: columns that act in few blocks show little of it.
        """
        left, clusters = self._residual - own @ c, int(self._blocks.max()) + 1
        scores = np.stack([np.bincount(self._blocks, column * left, clusters) for column in own.T], axis=1)
        # what the prior holds back is in all of them
        scores -= scores.mean(axis=0)
        alike = ROWS_FOR_ONE * float(np.mean(left**2)) * own.T @ own
        return np.asarray(scores.T @ scores * clusters / max(clusters - len(c), 1) + alike)

    def _of_left_over(self, own: Array) -> Array:
        """(k, k) covariance of the coefficients by what the model left over."""
        total = np.zeros((own.shape[1], own.shape[1]))
        if self._known is None:
            return total
        fit, held_out = self._data
        parts, rows = np.split(own, [len(fit.y)]), fit.rows + held_out.rows
        for joint, left in enumerate(self._known.left_over.tolist(), 1):
            at = [part[side.of(joint)] for part, side in zip(parts, self._data)]
            total += LOOKS_ALIKE * rows * left / (1.0 + left) * sum(one.T @ one for one in at)
        return total
