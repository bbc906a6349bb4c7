"""From a fit to what a person reads.

Checks, predictions, named parameters with their uncertainty, an arm that could exist.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, parameter, with_parameters
from arm_model.servo import fixed_gains
from daq.recording import Recording
from identification.preprocessing import checks
from identification.preprocessing.signals import parallel_filter, sliding_rows, with_reversals
from identification.preprocessing.spectrum import Band
from identification.regression.effect_columns import is_effect, shown_torque
from identification.regression.equations import Equations, model_values
from identification.regression.least_squares import Fit, relative_error
from identification.regression.physical_consistency import consistent_parameters
from identification.regression.problem import Problem
from identification.regression.uncertainty import Uncertainty
from identification.result import Identification, Prediction, Value, unit_of

SPLIT = 0.7  # share of the time that is fitted where no recording is held out
CERTAIN = 0.3  # of the value: a parameter with a larger standard deviation counts as not identifiable
FELT = 0.02  # of the torque: unless the uncertainty is no more than this share of what the joints do


def physical_values(problem: Problem, fit: Fit, information: Array) -> Array:
    """(p,) standard parameters of the physically consistent arm nearest to a fit."""
    return consistent_parameters(
        problem.base.grouping[problem.excited],
        fit.values,
        information,
        model_values(problem.arm, problem.friction),
        problem.base.names,
    )


def with_values(problem: Problem, physical: Array) -> Arm:
    """The arm with standard parameters ``physical`` (p,).

    Where the model's Coulomb friction differs by direction, what symmetric friction calls an offset stays such a
    difference: while a joint moves the two are one, but at rest an offset is a torque and a difference is none.
    """
    values = dict(zip(problem.base.names, map(float, physical)))
    if problem.friction == "asymmetric":  # what was constant is in the two magnitudes now
        values |= {f"joint{j}.offset": 0.0 for j in range(1, len(problem.arm) + 1)}
    else:
        now = dict(zip(problem.base.names, model_values(problem.arm, problem.friction)))
        for j, joint in enumerate(problem.arm.joints, 1):
            uneven = joint.ratio * (joint.coulomb[0] - joint.coulomb[1]) / 2
            uneven += values[f"joint{j}.offset"] - now[f"joint{j}.offset"]
            if joint.coulomb[0] != joint.coulomb[1] and abs(uneven) <= values[f"joint{j}.coulomb"]:
                values[f"joint{j}.coulomb_positive"] = values[f"joint{j}.coulomb"] + uneven
                values[f"joint{j}.coulomb_negative"] = values.pop(f"joint{j}.coulomb") - uneven
                values[f"joint{j}.offset"] = joint.ratio * joint.offset
    return with_parameters(fixed_gains(problem.arm), values)  # the real servo does not follow our estimates


def conclude(
    problem: Problem, method: str, best: Fit, spread: Uncertainty, solve: Callable[[Equations], Fit]
) -> Identification:
    """The result of a fit: predictions, named parameters, a consistent arm.

    ``solve`` refits part of the rows for the split.
    """
    _check_friction(problem, best, spread)
    warnings = list(problem.warnings)
    physical = physical_values(problem, best, spread.information)
    identified = with_values(problem, physical)
    predictions, held_names = _predictions(problem, best, solve, warnings)
    for recording, run in zip(problem.fit, predictions):
        sentences = checks.unexplained_channels(recording.path, run.residual, run.measured, run.joint)
        warnings += [f"{run.run}: {sentence}" for sentence in sentences]
    predictions = _accounted_for(problem, predictions, identified, spread)
    reduced = problem.base.grouping[problem.excited] @ physical
    compared = {"physically consistent model": _errors(problem, reduced)}
    base, parameters = _named(problem, best, spread, physical)
    weak = [value.name for value in base if not value.identifiable]
    if weak:
        warnings.append(
            f"{len(weak)} of {len(base)} base parameters cannot be identified from these runs: {', '.join(weak[:6])}"
            + (" ..." if len(weak) > 6 else "")
        )
    notes = [
        f"cut-off {motion.band.motion:.3g} Hz for differentiation, {motion.band.parallel:.3g} Hz for the "
        "regression, from the"
        f" spectrum of {recording.path.name}"
        for recording, motion in zip(problem.fit, problem.motions)
    ]
    notes.append(
        f"standard deviations from {spread.blocks} blocks of {spread.block:.3g} s; those of the formula take "
        "residuals for white"
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
        notes=notes,
        bands=[motion.band for motion in problem.motions],
        covariance=spread.covariance,
        compared=compared,
        runs=problem.runs,
    )


def _check_friction(problem: Problem, best: Fit, spread: Uncertainty) -> None:
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
            head, _, rest = problem.base.names[column].partition(".")
            if head == f"joint{j + 1}" and not is_effect(problem.base.names[column]):
                weight[k] = mean.get(rest.partition("_")[0], 0.0) * (0.5 if rest.endswith("tive") else 1.0)
        power[j] = weight @ best.values
        std[j] = float(weight @ spread.covariance @ weight) ** 0.5
    checks.check_signs([recording.path for recording in problem.fit], power, std)


def _predictions(
    problem: Problem, best: Fit, solve: Callable[[Equations], Fit], warnings: list[str]
) -> tuple[list[Prediction], list[str] | str]:
    found = _predicted(problem, problem.judged, best.values, problem.fit, False)
    if problem.held is not None:
        names = [str(recording.path) for recording in problem.held_out]
        return found + _predicted(problem, problem.held, best.values, problem.held_out, True), names
    ends = np.array([motion.t[-1] for motion in problem.motions])
    window = np.array([4 / motion.band.parallel for motion in problem.motions])
    early = problem.rows.t < (SPLIT * ends - window)[problem.rows.run]
    late = problem.judged.t > SPLIT * ends[problem.judged.run]
    warnings.append(
        f"no recording is held out: the held-out error is that of the last {1 - SPLIT:.0%} of the same runs, "
        f"predicted from the first {SPLIT:.0%};"
        " give --held-out recordings of another motion before calling this model validated"
    )
    if early.sum() < 2 * len(problem.columns) or not late.any():
        return found, "split"
    # Trained on part of the time, a direction may be unexcited that all of it excites: then least norm.
    first = solve(problem.rows.of(early))
    return found + _predicted(problem, problem.judged.of(late), first.values, problem.fit, True), "split"


def _predicted(
    problem: Problem, rows: Equations, values: Array, recordings: Sequence[Recording], held_out: bool
) -> list[Prediction]:
    predicted = rows.columns[:, problem.columns] @ values + problem.given(rows)
    found = []
    for run, recording in enumerate(recordings):
        here = rows.run == run
        seen = (rows.t[here], rows.joint[here], rows.torque[here], predicted[here])
        found.append(
            Prediction(recording.path.name, held_out, *seen, None if rows.sliding is None else rows.sliding[here])
        )
    return found


def _accounted_for(problem: Problem, predictions: list[Prediction], arm: Arm, spread: Uncertainty) -> list[Prediction]:
    """The predictions, those of held-out runs with the errors expected from noise and from the parameters."""
    if problem.held is None:
        return predictions
    columns = problem.held.columns[:, problem.columns]
    std = np.sqrt(np.sum(columns @ spread.covariance * columns, axis=1))
    fitted, held = predictions[: len(problem.fit)], predictions[len(problem.fit) :]
    return fitted + [
        replace(each, prediction_std=std[problem.held.run == run], noise=_noise(problem, arm, motion.band)[each.joint])
        for run, (each, motion) in enumerate(zip(held, problem.held_motions))
    ]


def _noise(problem: Problem, arm: Arm, band: Band) -> Array:
    """(J,) rms error of an arm's torque on the sliding rows of the fitted runs through another run's filter.

    NaN for a joint without any.

    A held-out motion that is quicker needs a wider filter, which lets in more of the noise of encoders and of the
    servos' ripple.
    """
    off: list[list[Array]] = [[] for _ in arm.joints]
    for motion in problem.motions:
        view = with_reversals(replace(motion, band=replace(motion.band, parallel=band.parallel)))
        shown = shown_torque(arm, problem.arm, motion.q, motion.qd, motion.qdd, motion.t)
        error, sliding = parallel_filter(view, motion.torque - shown), sliding_rows(view)
        for j, column in enumerate(error.T):
            off[j].append(column[sliding[:, j]])
    return np.array([np.sqrt(np.mean(np.concatenate(parts) ** 2)) if any(map(len, parts)) else np.nan for parts in off])


def _errors(problem: Problem, values: Array) -> tuple[float, float]:
    """Relative error on the fitted and the held-out recordings."""
    found = []
    for rows in (problem.judged, problem.held):
        if rows is None:
            found.append(float("nan"))
            continue
        residual = rows.torque - problem.given(rows) - rows.columns[:, problem.columns] @ values
        found.append(relative_error(rows.torque, residual))
    return found[0], found[1]


def _named(problem: Problem, best: Fit, spread: Uncertainty, physical: Array) -> tuple[list[Value], list[Value]]:
    """Base parameters, and standard ones.

    Those that stand alone with their uncertainty, the others from the consistent arm.
    """
    base = problem.base
    estimated: dict[int, Value] = {}
    for k, row in enumerate(problem.excited):
        column = int(base.kept[row])
        mine = problem.rows.columns[:, column]
        touched = mine != 0
        felt = spread.std[k] * float(np.sqrt(np.mean(mine[touched] ** 2))) if touched.any() else np.inf
        torque = float(np.sqrt(np.mean(problem.rows.torque[touched] ** 2))) if touched.any() else 1.0
        certain = spread.std[k] <= CERTAIN * abs(best.values[k]) or felt <= FELT * torque
        why = "" if certain else f"known to {spread.std[k]:.2g} only: these runs excite it too little"
        estimated[int(row)] = Value(
            base.expression(int(row)),
            float(best.values[k]),
            float(spread.std[k]),
            float(spread.std_formula[k]),
            unit_of(base.names[column], problem.arm),
            bool(certain),
            why,
            float(spread.std_bootstrap[k]),
        )
    parameters = []
    standing = {int(base.kept[row]): int(row) for row in range(len(base))}
    silent = set(range(len(base))) - set(estimated)
    resting = {f"joint{j + 1}" for j in range(len(problem.arm))} - {f"joint{j + 1}" for j in problem.rows.joint}
    grouped = np.flatnonzero(np.any(base.grouping != 0, axis=0))
    for column, name in enumerate(base.names):
        row = standing.get(column)
        unit = unit_of(name, problem.arm)
        if row is not None and row in estimated and base.alone(row):
            parameters.append(replace(estimated[row], name=name))
            continue
        value = float(physical[column])
        if row in silent and not is_effect(name) and (joint := name.partition(".")[0]) in resting:
            why = (
                f"{joint} rests: friction holds it, bears any torque up to its own, and hides offset and "
                "rotor; from the model"
            )
            value = parameter(problem.arm, name)
        elif row in silent:
            why = "not excited by these runs; from the model"
        elif column in grouped:
            why = (
                "only in sums with others (base_parameters); this share of them is the physically "
                "consistent one nearest the model"
            )
        else:
            why = "moves no torque of this arm; from the model"
        parameters.append(Value(name, value, None, None, unit, False, why))
    return [estimated[int(row)] for row in problem.excited], parameters
