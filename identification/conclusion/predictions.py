"""What a fit predicts of fitted and held-out rows, and how large its errors are expected to be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from identification.preprocessing.signals import parallel_filter, sliding_rows, with_reversals
from identification.preprocessing.spectrum import Band
from identification.regression.effect_columns import Samples, shown_torque
from identification.regression.equations import Equations, shown_rows
from identification.regression.least_squares import Fit, relative_error
from identification.regression.physical_arm import physical_values, with_values
from identification.regression.problem import Problem
from identification.regression.uncertainty import FitUncertainty
from identification.result import Prediction

SPLIT = 0.7
"""Share of the time that is fitted where no recording is held out."""


def all_predictions(
    problem: Problem,
    best: Fit,
    identified: Arm,
    uncertainty: FitUncertainty,
    solve: Callable[[Equations], Fit],
    warnings: list[str],
) -> tuple[list[Prediction], tuple[float, float], list[str] | str]:
    """Predictions of the arm that is written, the relative errors of the fit itself, and what is held out.

    Without held-out recordings an arm made from the first part of each, in the same way, predicts the rest.
    """
    judged = [with_reversals(motion) for motion in problem.motions]
    found = predictions_of(problem.judged, shown_rows(identified, problem.arm, judged), problem.fit, False)
    fitted = _error(problem, problem.judged, best)
    if problem.held is not None:
        shown = shown_rows(identified, problem.arm, problem.held_motions)
        found += predictions_of(problem.held, shown, problem.held_out, True)
        names = [str(recording.path) for recording in problem.held_out]
        return found, (fitted, _error(problem, problem.held, best)), names
    ends = np.array([motion.t[-1] for motion in problem.motions])
    window = np.array([4 / motion.band.parallel for motion in problem.motions])
    early = problem.rows.t < (SPLIT * ends - window)[problem.rows.run]
    late = problem.judged.t > SPLIT * ends[problem.judged.run]
    warnings.append(
        f"no recording is held out: the held-out error is that of the last {1 - SPLIT:.0%} of the same runs, predicted "
        f"from the first {SPLIT:.0%}; give --held-out recordings of another motion before calling this model validated"
    )
    if early.sum() < 2 * len(problem.columns) or not late.any():
        return found, (fitted, float("nan")), "split"
    # The first part may leave a direction unexcited that the whole run excites: then least norm.
    first = solve(problem.rows.of(early))
    earlier = with_values(problem, physical_values(problem, first, uncertainty.of_rows))
    rows = problem.judged.of(late)
    found += predictions_of(rows, shown_rows(earlier, problem.arm, judged)[late], problem.fit, True)
    return found, (fitted, _error(problem, rows, first)), "split"


def predictions_of(
    rows: Equations, predicted: Array, recordings: Sequence[Recording], held_out: bool
) -> list[Prediction]:
    """One prediction per recording, of the torques ``predicted`` (rows,)."""
    predictions = []
    for run, recording in enumerate(recordings):
        of_run = rows.run == run
        seen = (rows.t[of_run], rows.joint[of_run], rows.torque[of_run], predicted[of_run])
        predictions.append(
            Prediction(recording.path.name, held_out, *seen, None if rows.sliding is None else rows.sliding[of_run])
        )
    return predictions


def accounted_for(
    problem: Problem, predictions: list[Prediction], arm: Arm, uncertainty: FitUncertainty
) -> list[Prediction]:
    """The predictions, those of held-out runs with the errors expected from noise and from the parameters."""
    if problem.held is None:
        return predictions
    columns = problem.held.columns[:, problem.columns]
    std = np.sqrt(np.sum(columns @ uncertainty.covariance * columns, axis=1))
    fitted, held = predictions[: len(problem.fit)], predictions[len(problem.fit) :]
    return fitted + [
        replace(each, prediction_std=std[problem.held.run == run], noise=_noise(problem, arm, motion.band)[each.joint])
        for run, (each, motion) in enumerate(zip(held, problem.held_motions))
    ]


def _noise(problem: Problem, arm: Arm, band: Band) -> Array:
    """(J,) rms error of an arm's torque on the sliding rows of the fitted runs, through the filter of another run.

    NaN for a joint without such rows.

    A held-out motion that is quicker needs a wider filter, which lets in more of the noise of encoders and of the
    servos' ripple.
    """
    off: list[list[Array]] = [[] for _ in arm.joints]
    for motion in problem.motions:
        view = with_reversals(replace(motion, band=replace(motion.band, parallel=band.parallel)))
        warm = replace(arm, temperatures=motion.temperatures)
        shown = shown_torque(warm, problem.arm, Samples(motion.q, motion.qd, motion.qdd, motion.t))
        error, sliding = parallel_filter(view, motion.torque - shown), sliding_rows(view)
        for j, column in enumerate(error.T):
            off[j].append(column[sliding[:, j]])
    return np.array([np.sqrt(np.mean(np.concatenate(parts) ** 2)) if any(map(len, parts)) else np.nan for parts in off])


def fit_residual(problem: Problem, rows: Equations, fit: Fit) -> Array:
    """(rows,) residual of the fitted values themselves, which need not make an arm that could exist."""
    return np.asarray(rows.torque - problem.given_torque(rows) - rows.columns[:, problem.columns] @ fit.values)


def _error(problem: Problem, rows: Equations, fit: Fit) -> float:
    """Relative error of the fitted values themselves."""
    return relative_error(rows.torque, fit_residual(problem, rows, fit))
