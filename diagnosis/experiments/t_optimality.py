"""How far apart the predictions of rival causes would be along a motion that nobody has recorded yet.

T-optimality (Atkinson & Fedorov, Biometrika 62, 1975): one rival is taken for true as the recordings so far show it;
every other is refit to what it predicts, on those recordings and on the new motion together, with all shapes of its own
and everything else of the model free; the distance of a pair is what no refit can close, and that of a motion is its
smallest pair's. In units of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.simulation import simulate
from diagnosis.cause import EffectKey
from diagnosis.experiments.motions import Stage, Trial
from diagnosis.measurements.currents.columns import columns
from diagnosis.measurements.currents.design_matrix import columns_of, dataset_of, free_columns
from diagnosis.residual.run import ROWS_FOR_ONE, ROWS_PER_SECOND, Run, residual_run
from diagnosis.residual.run_setup import loaded
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from experiment import demand_of

SIMULATED_RATE = 2.0 * ROWS_PER_SECOND
"""Rows/s of a simulated motion: enough for the bands of ``evidence``."""


@dataclass(frozen=True)
class Rival:
    """A cause that could be the true one.

    The shapes that it may be refit with, and how it explains the recordings so far.

    No shapes: the rival is that nothing of the kind is there.
    """

    key: EffectKey
    shapes: tuple[Candidate, ...]
    best: Candidate | None
    coefficients: Array


@dataclass(frozen=True)
class _Told:
    """Normal equations of one shape of a rival beside the nuisances: gram (r, r) of its columns.

    Toward (r, rivals) what each predicts.
    """

    gram: Array
    toward: Array


class Question:
    """Rivals, what stays free beside them (``nuisances``), and what the recordings so far say of both."""

    def __init__(self, rivals: Sequence[Rival], nuisances: Sequence[Candidate], runs: Sequence[Run], arm: Arm) -> None:
        self.rivals, self.nuisances, self.arm = tuple(rivals), tuple(nuisances), arm
        self.noise = np.mean([run.noise for run in runs], axis=0)
        self._told, self._squares = self._equations(dataset_of(runs))

    def apart(self, run: Run) -> dict[tuple[EffectKey, EffectKey], float]:
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
        """(rivals, rivals) standard deviations.

        By which what row k predicts for ``run`` stays away from what column l can be refit to.
        """
        count = len(self.rivals)
        found = np.full((count, count), np.inf)
        for k in range(count):
            here, squares = self._equations(dataset_of([self._told_by(k, run)]))
            for other in range(count):
                if k == other:
                    continue
                before = min(_left(told, self._squares, k) for told in self._told[other])
                both = min(
                    _left(_Told(t.gram + h.gram, t.toward + h.toward), self._squares + squares, k)
                    for t, h in zip(self._told[other], here[other])
                )
                found[k, other] = np.sqrt(max(both - before, 0.0) / ROWS_FOR_ONE)
        return found

    def _told_by(self, k: int, run: Run) -> Run:
        """The run as its currents would be with rival k there.

        Some columns are made of the current that is measured.
        """
        rival = self.rivals[k]
        if rival.best is None:
            return run
        current = run.current + columns(rival.best, run) @ rival.coefficients
        return replace(run, current=current, current_rate=np.gradient(current, 1.0 / ROWS_PER_SECOND, axis=0))

    def _equations(self, side: Dataset) -> tuple[list[list[_Told]], Array]:
        """For every rival, those of each of its shapes on one side.

        And the squares of what each rival predicts there.
        """
        length = len(side.y)
        free = [c.dense(length) for c in free_columns(side, self.arm)]
        free += [columns_of(c, side).dense(length) for c in self.nuisances]
        nuisance = np.hstack(free) if free else np.empty((length, 0))
        predicted = np.zeros((length, len(self.rivals)))
        for k, rival in enumerate(self.rivals):
            if rival.best is not None:
                predicted[:, k] = columns_of(rival.best, side).spread(rival.coefficients, length)
        told = []
        for rival in self.rivals:
            several = []
            for shape in rival.shapes or (None,):
                x = nuisance if shape is None else np.hstack([nuisance, columns_of(shape, side).dense(length)])
                several.append(_Told(x.T @ x, x.T @ predicted))
            told.append(several)
        return told, np.sum(predicted**2, axis=0)


def _left(told: _Told, squares: Array, k: int) -> float:
    """Squared distance of prediction k from the span: p^T p - r^T G^+ r, on unit columns."""
    scale = np.sqrt(np.diag(told.gram))
    seen = scale > 0
    if not seen.any():
        return float(squares[k])
    scale = scale[seen]
    values, vectors = np.linalg.eigh(told.gram[np.ix_(seen, seen)] / np.outer(scale, scale))
    keep = values > 1e-9 * values[-1]
    along = vectors[:, keep].T @ (told.toward[seen, k] / scale)
    return max(float(squares[k] - along @ (along / values[keep])), 0.0)


def rival_of(shapes: Sequence[Candidate], nuisances: Sequence[Candidate], runs: Sequence[Run], arm: Arm) -> Rival:
    """A rival as the recordings so far show it: its best shape beside the nuisances, fitted to their residuals."""
    side = dataset_of(runs)
    length = len(side.y)
    free = [c.dense(length) for c in free_columns(side, arm)]
    free += [columns_of(c, side).dense(length) for c in nuisances]
    fits = []
    for shape in shapes:
        x = np.hstack([columns_of(shape, side).dense(length), *free])
        scale = np.linalg.norm(x, axis=0)
        scale[scale == 0.0] = 1.0
        c = np.linalg.lstsq(x / scale, side.y, rcond=1e-8)[0] / scale
        fits.append((float(np.sum((side.y - x @ c) ** 2)), shape, c[: x.shape[1] - sum(f.shape[1] for f in free)]))
    _, best, coefficients = min(fits, key=lambda one: one[0])
    return Rival(best.key, tuple(shapes), best, coefficients)


def foreseen(trial: Trial, stage: Stage, noise: Array) -> Run | None:
    """The trial as the model moves through it, under the noise (n,) A that recordings show.

    None where it leaves the limits.
    """
    wanted, setup = trial.experiment, trial.experiment.setup
    demand = demand_of(wanted)
    arm = loaded(stage.arm, setup.payload)
    t = np.arange(int(demand.duration * SIMULATED_RATE) + 1) / SIMULATED_RATE
    if setup.drives_off:
        q, current = demand(np.zeros(len(t))), np.zeros((len(t), len(arm)))
    else:
        try:
            motion = simulate(arm, demand, duration=float(t[-1]), rate=SIMULATED_RATE, times=t)
        except InputError:  # its simulation diverges: no motion to ask for
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
    run = residual_run(wanted.name, arm, t, q, current, powered=not setup.drives_off)
    unsure = np.sqrt(np.maximum(run.deviation**2 - run.noise**2, 0.0))
    expected = run.along * run.powered  # another filter on the motion would tell apart what is the same
    rate = np.gradient(expected, 1.0 / ROWS_PER_SECOND, axis=0)
    return replace(run, current=expected, current_rate=rate, noise=noise, deviation=np.hypot(noise, unsure))
