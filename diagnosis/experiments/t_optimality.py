"""Discrimination distance of rival causes along a motion that has not been recorded yet.

T-optimality (Atkinson & Fedorov, Biometrika 62, 1975): one rival is assumed true, as the recordings show it; every
other one is refitted to its predictions, on those recordings and on the new motion together, with all its nonlinear
parameters and the nuisances free. The distance of a pair is the residual of that refit, and that of a motion is the
smallest of its pairs. In units of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.simulation import simulate_at
from diagnosis.cause import EffectKey
from diagnosis.experiments.motions import Stage, Trial
from diagnosis.measurements.currents.columns import columns
from diagnosis.measurements.currents.design_matrix import columns_of, dataset_of, free_columns
from diagnosis.residual.filters import ROWS_PER_SECOND
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import KnownNoise
from diagnosis.residual.run import Run
from diagnosis.residual.run_setup import loaded
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from experiment import demand_of
from identification.selection import scaled_lstsq

SIMULATED_RATE = 2.0 * ROWS_PER_SECOND
"""Rows/s of a simulated motion: enough for the bands of ``residual``."""


@dataclass(frozen=True)
class Rival:
    """A cause that may be the true one.

    shapes              candidates that it may be refitted with; none: the rival is that no such effect is present
    best, coefficients  how it explains the recordings
    """

    key: EffectKey
    shapes: tuple[Candidate, ...]
    best: Candidate | None
    coefficients: Array


@dataclass(frozen=True)
class _Equations:
    """Normal equations of one shape of a rival with the nuisances.

    gram    (r, r) of its columns
    toward  (r, rivals): its columns times the prediction of each rival
    """

    gram: Array
    toward: Array


class Question:
    """Rivals, free ``nuisances``, and the normal equations of both in the recordings."""

    def __init__(self, rivals: Sequence[Rival], nuisances: Sequence[Candidate], runs: Sequence[Run], arm: Arm) -> None:
        self.rivals, self.nuisances, self.arm = tuple(rivals), tuple(nuisances), arm
        self.noise = np.mean([run.noise for run in runs], axis=0)
        self._normal, self._squares = self._equations(dataset_of(runs))

    def pair_distances(self, run: Run) -> dict[tuple[EffectKey, EffectKey], float]:
        """The distance of every pair of rivals, whichever of the two is true; see ``distances``."""
        found = self.distances(run)
        count = range(len(self.rivals))
        return {
            (self.rivals[k].key, self.rivals[other].key): float(min(found[k, other], found[other, k]))
            for k in count
            for other in count
            if k < other
        }

    def distances(self, run: Run) -> Array:
        """(rivals, rivals) std: distance of the prediction of rival k for ``run`` from the best refit of rival l."""
        count = len(self.rivals)
        found = np.full((count, count), np.inf)
        for k in range(count):
            here, squares = self._equations(dataset_of([self._under(k, run)]))
            for other in range(count):
                if k == other:
                    continue
                before = min(_residual(equations, self._squares, k) for equations in self._normal[other])
                both = min(
                    _residual(_Equations(t.gram + h.gram, t.toward + h.toward), self._squares + squares, k)
                    for t, h in zip(self._normal[other], here[other])
                )
                found[k, other] = np.sqrt(max(both - before, 0.0) / run.alike)
        return found

    def _under(self, k: int, run: Run) -> Run:
        """The run with the currents that rival k predicts: the column of a delay is their measured rate."""
        rival = self.rivals[k]
        if rival.best is None:
            return run
        current = run.current + columns(rival.best, run) @ rival.coefficients
        return replace(run, current=current, current_rate=run.rate(current))

    def _equations(self, side: Dataset) -> tuple[list[list[_Equations]], Array]:
        """Normal equations of each shape of every rival in a dataset, and the squares of their predictions."""
        length = len(side.y)
        nuisance = _dense(self.nuisances, side, self.arm)
        predicted = np.zeros((length, len(self.rivals)))
        for k, rival in enumerate(self.rivals):
            if rival.best is not None:
                predicted[:, k] = columns_of(rival.best, side).contribution(rival.coefficients, length)
        equations = []
        for rival in self.rivals:
            of_rival = []
            for shape in rival.shapes or (None,):
                x = nuisance if shape is None else np.hstack([nuisance, columns_of(shape, side).dense(length)])
                of_rival.append(_Equations(x.T @ x, x.T @ predicted))
            equations.append(of_rival)
        return equations, np.sum(predicted**2, axis=0)


def _residual(equations: _Equations, squares: Array, k: int) -> float:
    """Squared distance of prediction k from the span: p^T p - r^T G^+ r, on unit columns."""
    scale = np.sqrt(np.diag(equations.gram))
    seen = scale > 0
    if not seen.any():
        return float(squares[k])
    scale = scale[seen]
    values, vectors = np.linalg.eigh(equations.gram[np.ix_(seen, seen)] / np.outer(scale, scale))
    keep = values > 1e-9 * values[-1]
    along = vectors[:, keep].T @ (equations.toward[seen, k] / scale)
    return max(float(squares[k] - along @ (along / values[keep])), 0.0)


def _dense(nuisances: Sequence[Candidate], side: Dataset, arm: Arm) -> Array:
    """(N, k): the columns that are always free, and those of the nuisances."""
    columns = [*free_columns(side, arm), *(columns_of(c, side) for c in nuisances)]
    return np.hstack([np.empty((len(side.y), 0)), *(c.dense(len(side.y)) for c in columns)])


def rival_of(shapes: Sequence[Candidate], nuisances: Sequence[Candidate], runs: Sequence[Run], arm: Arm) -> Rival:
    """A rival as the recordings show it: its best shape, fitted to their residuals with the nuisances."""
    side = dataset_of(runs)
    nuisance, fits = _dense(nuisances, side, arm), []
    for shape in shapes:
        x = np.hstack([columns_of(shape, side).dense(len(side.y)), nuisance])
        c = scaled_lstsq(x, side.y, 1e-8)
        fits.append((float(np.sum((side.y - x @ c) ** 2)), shape, c[: x.shape[1] - nuisance.shape[1]]))
    _, best, coefficients = min(fits, key=lambda one: one[0])
    return Rival(best.key, tuple(shapes), best, coefficients)


def predicted_run(trial: Trial, stage: Stage, noise: Array) -> Run | None:
    """The residual of a trial as simulated by the model, with noise (n,) A; None where it exceeds the limits."""
    experiment, setup = trial.experiment, trial.experiment.setup
    demand = demand_of(experiment)
    arm = loaded(stage.arm, setup.payload)
    t = np.arange(int(demand.duration * SIMULATED_RATE) + 1) / SIMULATED_RATE
    if setup.drives_off:
        q, current = demand(np.zeros(len(t))), np.zeros((len(t), len(arm)))
    else:
        try:
            motion = simulate_at(arm, demand, t)
        except InputError:  # the simulation diverges: the motion is not feasible
            return None
        limits, q, current = stage.limits, motion.qm, motion.current
        over = np.abs(motion.torque).max(axis=0) > limits.torque
        fast = np.abs(motion.qmd).max(axis=0) > 1.2 * limits.speed
        moved = list(trial.joints)
        slack = 0.02 * np.ptp(limits.position, axis=1) + 1e-3
        low, high = limits.position[:, 0] - slack, limits.position[:, 1] + slack
        out = [(q[:, j - 1].min() < low[j - 1]) or (q[:, j - 1].max() > high[j - 1]) for j in moved]
        if over.any() or fast.any() or any(out):
            return None
    noise_known = KnownNoise(steps=np.zeros(len(arm)), residual=noise)
    run = residual_run(experiment.name, arm, t, q, current, powered=not setup.drives_off, known=noise_known)
    expected = run.along * run.powered  # with another filter on the motion, equal effects would seem to differ
    return replace(run, current=expected, current_rate=run.rate(expected))
