"""From a fit to a result: checks, predictions, named parameters with uncertainty, a physically consistent arm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from arm_io import counted
from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from identification.preprocessing import checks
from identification.preprocessing.attenuation import attenuation_warnings
from identification.preprocessing.signals import parallel_filter, sliding_rows, with_reversals
from identification.preprocessing.spectrum import Band
from identification.regression.effect_columns import is_effect, shown_torque
from identification.regression.equations import Equations, shown_rows
from identification.regression.identifiability import base_and_standard_values
from identification.regression.least_squares import Fit, least_squares, relative_error
from identification.regression.model_parameters import model_values
from identification.regression.parameter_covariance import known_to
from identification.regression.physical_arm import physical_values, with_values
from identification.regression.problem import Problem
from identification.regression.uncertainty import FitUncertainty, fit_uncertainty
from identification.result import Identification, Prediction

MOST_NAMED = 6
"""Weak parameters in a warning."""
UNBIASED = ("iv", "didim")
"""Methods whose regressors have no noise of the encoders."""
UNCONSTRAINED = "least squares alone, not physically consistent"
"""Name of the fit itself beside the arm that is written."""
SPLIT = 0.7
"""Share of the time that is fitted where no recording is held out."""


def warnings_of_fit(problem: Problem) -> list[str]:
    """What plain least squares say of the recordings; InputError where an identification would refuse its fit."""
    rows = problem.rows
    columns, torque = rows.columns[:, problem.columns], rows.torque - problem.given_torque(rows)
    best = least_squares(columns, torque, rows.joint)
    _check_friction(problem, best, fit_uncertainty(columns, rows, best))
    return _unexplained_channels(problem, best)


def _unexplained_channels(problem: Problem, best: Fit) -> list[str]:
    """Sentences on currents that hardly follow the motion of their joint; InputError where one does not at all."""
    # judged by the unconstrained fit, which follows the channel even if no possible arm does
    unconstrained, judged, found = _residual(problem, problem.judged, best), problem.judged, []
    torque = judged.torque if judged.rest is None else judged.torque - judged.rest
    level = (np.bincount(judged.joint, torque) / np.maximum(np.bincount(judged.joint), 1))[judged.joint]
    for number, recording in enumerate(problem.fit):
        here = judged.run == number
        sentences = checks.unexplained_channels(
            recording.path,
            unconstrained[here],
            judged.columns[here],
            torque[here],
            level[here],
            judged.joint[here],
            problem.arm,
        )
        found += [f"{recording.path.name}: {sentence}" for sentence in sentences]
    return found + _of_another_unit(problem)


def _of_another_unit(problem: Problem) -> list[str]:
    """Warnings of recordings whose torques follow the model's links but are many times as large, or small."""
    rows, values = problem.rows, model_values(problem.arm, problem.friction)
    links = np.array([name.startswith("link") for name in rows.names])
    rigid = rows.columns[:, links] @ values[links]
    torque = rows.torque if rows.rest is None else rows.torque - rows.rest
    others = rows.columns[:, ~links]
    others = others[:, others.any(axis=0)]
    found = []
    for number, recording in enumerate(problem.fit):
        here = rows.run == number
        ratio = checks.times_the_expected(rigid[here], others[here], torque[here], rows.joint[here])
        if ratio is not None:
            times = f"{float(f'{ratio:.2g}'):g} times those of the model"
            found.append(
                f"{recording.path.name}: masses and inertias by the currents or torques are {times}; are the currents "
                "or torques in the unit of the model, and are gears and torque constants right?"
            )
    return found


def conclude(
    problem: Problem, method: str, best: Fit, uncertainty: FitUncertainty, solve: Callable[[Equations], Fit]
) -> Identification:
    """The result of a fit: predictions, named parameters, a consistent arm.

    ``solve`` refits a part of the rows, for the error of the split by time.
    """
    _check_friction(problem, best, uncertainty)
    warnings = list(problem.warnings)
    if method not in UNBIASED:
        warnings += attenuation_warnings(problem.motions)
    physical = physical_values(problem, best, uncertainty.of_rows)
    identified = with_values(problem, physical)
    predictions, compared, held_names = _predictions(problem, best, identified, uncertainty, solve, warnings)
    warnings += _unexplained_channels(problem, best)
    predictions = _accounted_for(problem, predictions, identified, uncertainty)
    identified = replace(identified, uncertainty=known_to(problem, uncertainty))
    base, parameters = base_and_standard_values(problem, best, uncertainty, physical)
    if weak := [value.name for value in base if not value.identifiable]:
        warnings.append(
            f"{len(weak)} of {len(base)} base parameters cannot be identified from these runs: {_weak_in_words(weak)}"
        )
    return Identification(
        method=method,
        friction=problem.friction,
        arm=identified,
        fit=[str(recording.path) for recording in problem.fit],
        held_out=held_names,
        parameters=parameters,
        base=base,
        condition=best.condition,
        predictions=predictions,
        warnings=warnings,
        notes=list(_notes(problem, uncertainty)),
        bands=[motion.band for motion in problem.motions],
        covariance=uncertainty.covariance,
        compared={UNCONSTRAINED: compared},
        runs=problem.runs,
    )


def _notes(problem: Problem, uncertainty: FitUncertainty) -> Iterator[str]:
    """Bands and blocks that the fit was made with."""
    for recording, motion in zip(problem.fit, problem.motions):
        yield (
            f"cut-off {motion.band.motion:.3g} Hz for differentiation, {motion.band.parallel:.3g} Hz for the "
            f"regression, from the spectrum of {recording.path.name}"
        )
    yield (
        f"standard deviations from {uncertainty.blocks} blocks of {uncertainty.block:.3g} s; those of the textbook "
        "formula assume white residuals"
    )


def _weak_in_words(names: Sequence[str]) -> str:
    """The first of the names; of friction curves only how many of a joint's speeds they are."""
    speeds = Counter(name.partition(".")[0].removeprefix("joint") for name in names if ".curve" in name)
    others = [name for name in names if ".curve" not in name]
    listed = [*others[:MOST_NAMED], *["..."] * (len(others) > MOST_NAMED)]
    curves = [f"friction of joint {j} at {counted(n, 'speed')} of its curve" for j, n in speeds.items()]
    return ", ".join([*listed, *curves])


def _check_friction(problem: Problem, best: Fit, uncertainty: FitUncertainty) -> None:
    """Friction that drives its joint is a current of the wrong sign."""
    joints = len(problem.arm)
    power, std = np.zeros(joints), np.ones(joints)
    for j in range(joints):
        speed = np.concatenate([motion.qd[motion.usable[:, j], j] for motion in problem.motions])
        if not len(speed):
            continue
        mean = {"viscous": np.mean(speed**2), "coulomb": np.mean(np.abs(speed))}
        weight = np.zeros(len(problem.columns))
        for k, column in enumerate(problem.columns):
            head, _, quantity = problem.base.names[column].partition(".")
            if head == f"joint{j + 1}" and not is_effect(problem.base.names[column]):
                weight[k] = mean.get(quantity.partition("_")[0], 0.0) * (0.5 if quantity.endswith("tive") else 1.0)
        power[j] = weight @ best.values
        std[j] = float(weight @ uncertainty.covariance @ weight) ** 0.5
    checks.check_signs([recording.path for recording in problem.fit], power, std, problem.arm)


def _predictions(
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


def _accounted_for(
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
        shown = shown_torque(warm, problem.arm, motion.q, motion.qd, motion.qdd, motion.t)
        error, sliding = parallel_filter(view, motion.torque - shown), sliding_rows(view)
        for j, column in enumerate(error.T):
            off[j].append(column[sliding[:, j]])
    return np.array([np.sqrt(np.mean(np.concatenate(parts) ** 2)) if any(map(len, parts)) else np.nan for parts in off])


def _residual(problem: Problem, rows: Equations, fit: Fit) -> Array:
    """(rows,) residual of the fitted values themselves, which need not make an arm that could exist."""
    return np.asarray(rows.torque - problem.given_torque(rows) - rows.columns[:, problem.columns] @ fit.values)


def _error(problem: Problem, rows: Equations, fit: Fit) -> float:
    """Relative error of the fitted values themselves."""
    return relative_error(rows.torque, _residual(problem, rows, fit))
