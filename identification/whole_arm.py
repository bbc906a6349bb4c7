"""Recordings -> the parameters of an arm, by linear regression on its inverse dynamics: the steps in order.

check -> smooth -> equations -> base parameters -> fit -> uncertainty -> prediction of held-out runs -> a physically consistent arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm
from arm_model.parameters import with_parameters
from arm_model.servo import fixed_gains
from daq.recording import Recording
from identification import refusals
from identification.base_parameters import BaseParameters, base_parameters
from identification.consistency import consistent_parameters
from identification.doubts import trusted
from identification.effects import is_effect, left_to_the_model, true_readings
from identification.equations import (
    Equations,
    Friction,
    equations,
    model_values,
    shown_rows,
    structural_base,
    with_effects,
)
from identification.least_squares import Fit, Method, least_squares, relative_error, weighted
from identification.readiness import Excitation, RunReadiness, readiness_of
from identification.result import Identification, Prediction, Value, unit_of
from identification.signals import Motion, smooth_motion, with_reversals
from identification.uncertainty import Uncertainty, uncertainty

Array = NDArray[np.float64]
Progress = Callable[[str], None]

SPLIT = 0.7  # share of the time that is fitted where no recording is held out
EXCITED = 1e-4  # share of a column that no other explains; below it, this experiment says nothing about the parameter
# Gauss-Newton steps of an arm with effects, at most; a step of fewer standard deviations is the last.
STEPS, SETTLED = 8, 0.1
SHORTEST = 1 / 16  # of a step
CERTAIN = 0.3  # of the value: a parameter with a larger standard deviation counts as not identifiable
FELT = 0.02  # of the torque: unless the uncertainty is no more than this share of what the joints do


@dataclass(frozen=True)
class Problem:
    """What is regressed: the arm, the runs, their rows and the columns that this data excites.

    base    what the arm could show; excited: indices into it that this data shows
    rows    those that are fitted; judged, held: those, reversals and all, of the fitted and the held-out runs (None: split) to judge on
    runs    how fit each recording is, fitted ones first
    """

    arm: Arm
    friction: Friction
    fit: Sequence[Recording]
    held_out: Sequence[Recording]
    motions: list[Motion]
    held_motions: list[Motion]
    rows: Equations
    judged: Equations
    held: Equations | None
    base: BaseParameters
    excited: NDArray[np.intp]
    warnings: list[str]
    runs: list[RunReadiness]

    @property
    def columns(self) -> NDArray[np.intp]:
        """Indices of the excited base parameters' columns among the standard ones."""
        return self.base.kept[self.excited]

    def given(self, rows: Equations) -> Array:
        """(rows,) torque of the base parameters that this data does not excite, at the model's own values; and what no column carries."""
        silent = np.setdiff1d(np.arange(len(self.base)), self.excited)
        values = self.base.grouping[silent] @ model_values(self.arm, self.friction)
        torque = rows.columns[:, self.base.kept[silent]] @ values
        return np.asarray(torque if rows.rest is None else torque + rows.rest)

    def around(self, arm: Arm) -> Problem:
        """The same equations with effects taken at the values of ``arm``."""
        common = self.friction, self.base
        rows = with_effects(self.rows, arm, self.arm, self.motions, *common)
        judged = with_effects(self.judged, arm, self.arm, list(map(with_reversals, self.motions)), *common)
        held = None if self.held is None else with_effects(self.held, arm, self.arm, self.held_motions, *common)
        return replace(self, rows=rows, judged=judged, held=held)


def motion_of(recording: Recording, arm: Arm) -> tuple[Motion, RunReadiness]:
    """The smooth motion of a recording, and how fit it is. Torques are its currents times the arm's drive constants; errors of angle and time
    that the arm has as effects are put right, what the instruments doubt is left out."""
    found = trusted(recording)
    q, current = true_readings(arm, recording.t, found.q, found.i)
    motion = smooth_motion(recording.t, q, current * arm.joint_array("drive_constant"), saturated=found.saturated)
    refusals.check_motion(recording.path, motion)
    return motion, readiness_of(recording, found, motion, arm)


def motions_of(
    fit: Sequence[Recording], held_out: Sequence[Recording], arm: Arm, progress: Progress = lambda _: None
) -> tuple[list[Motion], list[Motion], list[RunReadiness]]:
    """Smooth motions of the fitted and of the held-out recordings, and how fit each is; InputError for one that cannot be used at all."""
    for recording in [*fit, *held_out]:
        refusals.check_recording(recording, arm)
    progress("smoothing")
    seen = [motion_of(recording, arm) for recording in [*fit, *held_out]]
    return (
        [motion for motion, _ in seen[: len(fit)]],
        [with_reversals(motion) for motion, _ in seen[len(fit) :]],
        [run for _, run in seen],
    )


def prepare(
    fit: Sequence[Recording],
    arm: Arm,
    *,
    held_out: Sequence[Recording] = (),
    friction: Friction = "symmetric",
    progress: Progress = lambda _: None,
    sparse: bool = False,
) -> Problem:
    """Checks the recordings and makes their equations; InputError where nothing can come of them.

    ``sparse``: the runs are of one joint each and need not excite the whole arm.
    """
    motions, held_motions, runs = motions_of(fit, held_out, arm, progress)
    # Ripples reach to the low-pass's edge, where both sides differ; leaving samples out would fold that onto the motion.
    motions = [*map(with_reversals, motions)] if arm.effects else motions
    warnings = [warning for run in runs for warning in run.warnings]
    warnings += [
        f"{name}: held as the model has it, and counted as rigid or sliding here" for name in left_to_the_model(arm)
    ]
    progress("equations of motion")
    base = structural_base(arm, friction)
    rows = equations(arm, motions, friction, base)
    judged = equations(arm, list(map(with_reversals, motions)), friction, base)
    held = equations(arm, held_motions, friction, base) if held_motions else None
    shown = rows.columns[:, base.kept] / _spread(rows, arm)[:, None]
    if len(shown) < (1 if sparse else 2) * len(base):
        raise refusals.too_short([recording.path for recording in fit], len(shown), len(base))
    labels = [base.names[k] for k in base.kept]
    excited = base_parameters(shown, labels, order=range(len(base)), negligible=EXCITED).kept
    excited = np.sort(excited)
    for k in [] if sparse else np.setdiff1d(np.arange(len(base)), excited):
        warnings.append(f"{base.expression(int(k))}: not excited by these runs; taken from the model")
    return Problem(
        arm, friction, fit, held_out, motions, held_motions, rows, judged, held, base, excited, warnings, runs
    )


def _spread(rows: Equations, arm: Arm) -> Array:
    """(rows,) standard deviation of the torque of each row's joint."""
    mine = [rows.torque[rows.joint == j] for j in range(len(arm))]
    return np.array([max(float(np.std(torque)), 1e-12) if len(torque) else 1.0 for torque in mine])[rows.joint]


def identify(
    fit: Sequence[Recording],
    arm: Arm,
    *,
    held_out: Sequence[Recording] = (),
    method: Method = "wls",
    friction: Friction = "symmetric",
    progress: Progress = lambda _: None,
) -> Identification:
    """Parameters of ``arm`` from recordings by least squares (``method`` ols, wls or irls), judged on ``held_out``.

    Without held-out recordings the first 70 % of the time predict the rest, and the result carries a warning. Raises InputError where the
    recordings are unusable.
    """
    problem = prepare(fit, arm, held_out=held_out, friction=friction, progress=progress)

    def solve(rows: Equations) -> Fit:
        return least_squares(rows.columns[:, problem.columns], rows.torque - problem.given(rows), rows.joint, method)

    values, before = model_values(arm, friction), None
    for number in range(STEPS if arm.effects else 1):
        progress(f"least squares, step {number + 1}" if arm.effects else "least squares")
        best = solve(problem.rows)
        progress("uncertainty")
        spread = uncertainty(problem.rows.columns[:, problem.columns], problem.rows, best)
        if not arm.effects or (before is not None and np.all(np.abs(best.values - before) < SETTLED * spread.std)):
            break
        before, values = (
            best.values,
            _towards(problem, values, physical_values(problem, best, spread.information), best),
        )
        problem = problem.around(with_values(problem, values))
    else:
        problem.warnings.append(
            f"the effects did not settle in {STEPS} steps; is one of them far from what the model says?"
        )
    return conclude(problem, method, best, spread, solve)


def physical_values(problem: Problem, fit: Fit, information: Array) -> Array:
    """(p,) standard parameters of the physically consistent arm nearest to a fit."""
    return consistent_parameters(
        problem.base.grouping[problem.excited],
        fit.values,
        information,
        model_values(problem.arm, problem.friction),
        problem.base.names,
    )


def _towards(problem: Problem, now: Array, wanted: Array, fit: Fit) -> Array:
    """As far from the parameters ``now`` (p,) towards ``wanted`` as the arm shows the torques better: a line search by halves.

    Both are consistent arms, and so is all that lies between.
    """

    def cost(values: Array) -> float:
        shown = shown_rows(with_values(problem, values), problem.arm, problem.motions)
        return float(np.sum((fit.weight * (problem.rows.torque - shown)) ** 2))

    least, length = cost(now), 1.0
    while cost(now + length * (wanted - now)) > least and length > SHORTEST:
        length /= 2
    return now + length * (wanted - now)


def excitation_of(problem: Problem) -> Excitation:
    """What the fitted runs show of the arm, before anything is fitted: rows of a joint over the spread of its torque."""
    base, rows = problem.base, problem.rows
    fit = weighted(rows.columns[:, problem.columns], rows.torque, 1 / _spread(rows, problem.arm))
    silent = [base.expression(int(k)) for k in np.setdiff1d(np.arange(len(base)), problem.excited)]
    return Excitation(len(problem.excited), len(base), fit.condition, silent)


def conclude(
    problem: Problem, method: str, best: Fit, spread: Uncertainty, solve: Callable[[Equations], Fit]
) -> Identification:
    """The result of a fit: predictions, named parameters, a consistent arm. ``solve`` refits part of the rows for the split."""
    _check_friction(problem, best, spread)
    warnings = list(problem.warnings)
    warnings += refusals.unexplained_channels(best.residual, problem.rows.torque, problem.rows.joint)
    predictions, held_names = _predictions(problem, best, solve, warnings)
    physical = physical_values(problem, best, spread.information)
    identified = with_values(problem, physical)
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
        f"cut-off {motion.band.motion:.3g} Hz for differentiation, {motion.band.parallel:.3g} Hz for the regression, from the"
        f" spectrum of {recording.path.name}"
        for recording, motion in zip(problem.fit, problem.motions)
    ]
    notes.append(
        f"standard deviations from {spread.blocks} blocks of {spread.block:.3g} s; those of the formula take residuals for white"
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
    power, doubt = np.zeros(joints), np.ones(joints)
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
        doubt[j] = float(weight @ spread.covariance @ weight) ** 0.5
    refusals.check_signs([recording.path for recording in problem.fit], power, doubt)


def _predictions(
    problem: Problem, best: Fit, solve: Callable[[Equations], Fit], warnings: list[str]
) -> tuple[list[Prediction], list[str] | str]:
    found = _predicted(problem, problem.judged, best.values, problem.fit, False)
    if problem.held is not None:
        return found + _predicted(problem, problem.held, best.values, problem.held_out, True), [
            str(recording.path) for recording in problem.held_out
        ]
    ends = np.array([motion.t[-1] for motion in problem.motions])
    window = np.array([4 / motion.band.parallel for motion in problem.motions])
    early = problem.rows.t < (SPLIT * ends - window)[problem.rows.run]
    late = problem.judged.t > SPLIT * ends[problem.judged.run]
    warnings.append(
        f"no recording is held out: the held-out error is that of the last {1 - SPLIT:.0%} of the same runs, predicted from the first {SPLIT:.0%};"
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
    return [
        Prediction(recording.path.name, held_out, rows.t[here], rows.joint[here], rows.torque[here], predicted[here])
        for run, recording in enumerate(recordings)
        for here in [rows.run == run]
    ]


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


def with_values(problem: Problem, physical: Array) -> Arm:
    """The arm with standard parameters ``physical`` (p,)."""
    values = dict(zip(problem.base.names, map(float, physical)))
    if problem.friction == "asymmetric":  # what was constant is in the two magnitudes now
        values |= {f"joint{j}.offset": 0.0 for j in range(1, len(problem.arm) + 1)}
    return with_parameters(fixed_gains(problem.arm), values)  # the real servo does not follow our estimates


def _named(problem: Problem, best: Fit, spread: Uncertainty, physical: Array) -> tuple[list[Value], list[Value]]:
    """Base parameters, and standard ones: those that stand alone with their uncertainty, the others from the consistent arm."""
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
        )
    parameters = []
    standing = {int(base.kept[row]): int(row) for row in range(len(base))}
    silent = set(range(len(base))) - set(estimated)
    grouped = np.flatnonzero(np.any(base.grouping != 0, axis=0))
    for column, name in enumerate(base.names):
        row = standing.get(column)
        unit = unit_of(name, problem.arm)
        if row is not None and row in estimated and base.alone(row):
            found = estimated[row]
            parameters.append(
                Value(name, found.value, found.std, found.std_formula, unit, found.identifiable, found.why)
            )
            continue
        if row in silent:
            why = "not excited by these runs; from the model"
        elif column in grouped:
            why = "only in sums with others (base_parameters); this share of them is the physically consistent one nearest the model"
        else:
            why = "moves no torque of this arm; from the model"
        parameters.append(Value(name, float(physical[column]), None, None, unit, False, why))
    return [estimated[int(row)] for row in problem.excited], parameters
