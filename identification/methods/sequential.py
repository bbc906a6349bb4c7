"""Sequential identification: one link after the other, from the tip inwards, while the other joints are blocked.

Each step uses the results of the steps before (thesis, section 5.4).

While one joint moves alone, its equation shows few combinations of parameters, and with those of the outer links known
already, fewer still: each step is a small, well-conditioned fit. What a step finds is held by all later ones;
directions that no step shows stay where the model has them. The price: what a step gets wrong, the next ones inherit.
The stated covariance has that in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io import InputError
from arm_io.progress import Step
from arm_io.types import Array, Progress
from arm_model import Arm
from daq.recording import Recording
from identification.conclusion.conclude import conclude
from identification.methods.joint_by_joint import own_run
from identification.regression.equations import Equations
from identification.regression.least_squares import Fit, least_squares
from identification.regression.model_parameters import Friction, model_values
from identification.regression.problem import Problem, prepare
from identification.regression.uncertainty import fit_uncertainty
from identification.result import Identification

RANK_TOLERANCE = 1e-2
"""Share of a step's largest singular value: weaker directions wait for a later step."""


def identify_in_sequence(
    fit: Sequence[Recording],
    arm: Arm,
    *,
    held_out: Sequence[Recording],
    friction: Friction,
    progress: Progress,
) -> Identification:
    """Base parameters joint by joint; each joint from the runs in which it moves furthest.

    InputError where none moves.
    """
    problem = prepare(fit, arm, held_out=held_out, friction=friction, progress=progress, sparse=True)
    problem = replace(problem, excited=np.arange(len(problem.base)))
    size = _sizes(problem)
    values, covariance, steps = _steps(problem, size, progress)
    columns = problem.rows.columns[:, problem.columns]
    fitted = Fit(values, np.ones(len(columns)), problem.rows.torque - columns @ values, np.empty((0, 0)))
    # directions that no row excites keep the model's values
    doubt = np.diag(float(np.sqrt(np.mean(fitted.residual**2))) / size)
    uncertainty = fit_uncertainty(columns, problem.rows, fitted, prior=doubt)
    uncertainty = replace(
        uncertainty,
        covariance=covariance,
        std=np.sqrt(np.diag(covariance)),
        information=np.asarray(np.linalg.pinv(covariance, rcond=1e-12, hermitian=True), float),
        normal=(np.empty((0, len(values), len(values))), np.empty((0, len(values)))),
    )

    def solve(rows: object) -> Fit:
        return fitted

    result = conclude(problem, "sequence", fitted, uncertainty, solve)
    if problem.held is None:
        result.warnings.append("the later part of a sequence's runs is not held out: its steps used all of the time")
    result.notes.extend(steps)
    return result


@dataclass(frozen=True)
class Known:
    """What the steps so far have found of b parameters: values (b,), covariance (b, b), and what is left to later ones.

    open (b, k): columns span the directions that no step has shown yet; there the values are the model's.
    """

    values: Array
    covariance: Array
    open: Array


def next_step(known: Known, columns: Array, rows: Equations) -> tuple[Known, float]:
    """``known`` after a step: ``rows`` determine open directions; ``columns`` (rows, b) are those of the parameters.

    Also returns the condition number of the step; NaN if it shows no direction.

    The step fits what the values so far leave of the torque, and so takes their errors e for parameters of its own:
    of columns W and directions S that it shows its estimate moves by -(W S)^+ W e, and e becomes (1 - S (W S)^+ W) e.
    """
    singular, right = np.linalg.svd(np.linalg.qr(columns @ known.open, mode="r"))[1:]
    count = int(np.sum(singular > RANK_TOLERANCE * singular.max(initial=0.0)))
    if not count:
        return known, float("nan")
    shown = known.open @ right[:count].T
    fit = least_squares(columns @ shown, rows.torque - columns @ known.values, np.zeros(len(rows), np.intp), "ols")
    of_step = fit_uncertainty(columns @ shown, rows, fit).covariance
    inherits = np.eye(len(known.values)) - shown @ np.linalg.lstsq(columns @ shown, columns)[0]
    covariance = inherits @ known.covariance @ inherits.T + shown @ of_step @ shown.T
    return Known(known.values + shown @ fit.values, covariance, known.open @ right[count:].T), fit.condition


def _sizes(problem: Problem) -> Array:
    """(b,) sizes of the base parameters in the model; of those that are zero there, a tenth of the median of others."""
    start = np.abs(problem.base.grouping @ model_values(problem.arm, problem.friction))
    return np.maximum(start, 0.1 * float(np.median(start[start != 0])) if start.any() else 1.0)


def _steps(problem: Problem, size: Array, progress: Progress) -> tuple[Array, Array, list[str]]:
    """Values (b,) and covariance (b, b) of the base parameters, and a sentence per step; ``size`` (b,) of each."""
    base, rows = problem.base, problem.rows
    start = base.grouping @ model_values(problem.arm, problem.friction)
    # In units of ``size``. A direction that no step excites is as uncertain as its value in the model is large.
    known = Known(start / size, np.eye(len(base)), np.eye(len(base)))
    sentences = []
    for j in reversed(range(joints := len(problem.arm))):
        runs = [run for run, motion in enumerate(problem.motions) if own_run([motion], j) is not None]
        of_joint = rows.of(np.isin(rows.run, runs) & (rows.joint == j))
        if not len(of_joint):
            sentences.append(f"joint {j + 1} moves in no run; its step is left out")
            continue
        progress(Step("joints, tip first", joints - 1 - j, joints, detail=f"joint {j + 1}"))
        before = known.open.shape[1]
        known, condition = next_step(known, of_joint.columns[:, base.kept] * size, of_joint)
        count = before - known.open.shape[1]
        names = ", ".join(problem.fit[run].path.name for run in runs)
        sentences.append(f"joint {j + 1}: {count} combinations from {names}, condition {condition:.3g}")
    if known.open.shape[1] == len(base):
        raise InputError(
            ", ".join(str(r.path) for r in problem.fit), "no joint moves in any run; record one run per joint"
        )
    return known.values * size, known.covariance * size[:, None] * size, sentences
