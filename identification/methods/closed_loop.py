"""Identification against the simulated closed loop, whose motion is free of the measurement's noise.

iv      instrumental variables (IDIM-IV): the regressor of the simulated motion is correlated with the measured one but
        not with its noise, (Z^T W) beta = Z^T y; iterated (Janot, Vandanjon, Gautier, IEEE T-CST 22(1), 2014)
didim   closed-loop output error, measured torque against simulated, linear in the parameters once the simulated motion
        is taken for the real one: beta = least squares of y by Z; iterated (Gautier, Janot, Vandanjon, IEEE T-CST
        21(2), 2013)

Both need the demands of the run and a controller in the model that is the real one: a wrong controller makes a wrong
motion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from scipy import linalg

from arm_io import InputError
from arm_io.progress import Step
from arm_io.types import Array, Progress
from arm_model import Arm
from arm_model.simulation import simulate_at
from daq.recording import Recording
from identification.conclusion.conclude import conclude
from identification.methods.solution import converged
from identification.preprocessing.demands import demand_of_run
from identification.preprocessing.signals import Motion, smooth_motion
from identification.regression.equations import Equations, described_rows, with_effects
from identification.regression.least_squares import Fit, joint_noise, least_squares, weighted
from identification.regression.physical_arm import physical_values, with_values
from identification.regression.problem import Problem
from identification.regression.uncertainty import fit_uncertainty
from identification.regression.weak_directions import held_note, regularised_to_model
from identification.result import Identification

ClosedLoopMethod = Literal["iv", "didim"]

ITERATIONS = 8
"""Fits with regressors of newly simulated motions, at most."""
ASTRAY = 0.5
"""Share of the measured range: largest difference of a simulated motion from the measured one."""


def identify_closed_loop(problem: Problem, method: ClosedLoopMethod, *, progress: Progress) -> Identification:
    """IDIM-IV or DIDIM, from weighted least squares on.

    InputError where demands or controller are missing, or do not fit.
    """
    _check_closed_loop(problem, method)
    columns, torque = _regression(problem, problem.rows)
    fit = least_squares(columns, torque, problem.rows.joint, "wls")
    weight = 1.0 / joint_noise(fit.residual, problem.rows.joint)[problem.rows.joint]
    uncertainty = fit_uncertainty(columns, problem.rows, fit)
    taken = 0
    for number in range(ITERATIONS):
        taken = number + 1
        progress(Step(method, number, detail=f"simulation {taken}"))
        arm = with_values(problem, physical_values(problem, fit, uncertainty.of_rows))
        if arm.effects:
            problem = problem.around(arm)
            columns, torque = _regression(problem, problem.rows)
        simulated, of_simulated = _regression(problem, simulated_rows(problem, arm))
        before = fit.values
        if method == "iv":
            fit = _instrumental(simulated, columns, torque, weight)
            uncertainty = fit_uncertainty(columns, problem.rows, fit, instruments=simulated)
        else:
            fit = weighted(simulated, of_simulated, weight)
            uncertainty = fit_uncertainty(simulated, problem.rows, fit)
        if converged(before, fit, uncertainty):
            break
    # Errors are reported in the same way for every method: by the inverse dynamics on the measured motion.
    solved = Fit(fit.values, fit.weight, torque - columns @ fit.values, fit.scaled)
    solved, held = regularised_to_model(problem, solved, uncertainty.information)
    result = conclude(
        problem,
        method,
        solved,
        uncertainty,
        lambda rows: least_squares(
            rows.columns[:, problem.columns], rows.torque - problem.given_torque(rows), rows.joint, "wls"
        ),
    )
    result.notes.append(
        f"{method}: {taken} simulations of the closed loop" + ("" if taken < ITERATIONS else ", not settled")
    )
    result.notes.extend(held_note(held, len(problem.excited)))
    if problem.held is None:
        result.notes.append("the split's held-out error is that of weighted least squares")
    return result


def _check_closed_loop(problem: Problem, method: ClosedLoopMethod) -> None:
    """InputError where demands or controller are missing."""
    for recording in problem.fit:
        if recording.qref is None:
            raise InputError(
                recording.path, f"has no demanded positions (qref); method {method} simulates the closed loop from them"
            )
    if problem.arm.controller is None:
        raise InputError("model", f"has no [controller]; method {method} simulates the closed loop with it")


def _regression(problem: Problem, rows: Equations) -> tuple[Array, Array]:
    """Columns (rows, b) of the excited base parameters, and the torque (rows,) that they have to explain."""
    return rows.columns[:, problem.columns], rows.torque - problem.given_torque(rows)


def simulated_motion(arm: Arm, recording: Recording, motion: Motion) -> Motion:
    """The closed loop run on the recorded demands, smoothed as ``motion`` (of the recording) was, on its grid.

    InputError where it leaves the recorded motion.
    """
    demand = demand_of_run(recording, arm)
    run = simulate_at(arm, demand, motion.t, start=motion.q[0])
    off = np.max(np.abs(run.qm - motion.q), axis=0) / np.maximum(np.ptp(motion.q, axis=0), 1e-9)
    moving = motion.usable.any(axis=0)
    if not np.isfinite(run.qm).all() or np.any(off[moving] > ASTRAY):
        joint = int(np.argmax(np.where(moving, np.nan_to_num(off, nan=np.inf), 0))) + 1
        raise InputError(
            recording.path,
            f"the simulated joint {joint} departs from the recorded motion; the model's controller is not that of "
            "this run (methods ols, wls and irls do without it)",
        )
    return smooth_motion(motion.t, run.qm, run.torque, band=motion.band)


def simulated_rows(problem: Problem, arm: Arm) -> Equations:
    """The measured torques with the regressor on the simulated motions, for the rows that the measured ones keep."""
    moved = [simulated_motion(arm, recording, motion) for recording, motion in zip(problem.fit, problem.motions)]
    rows = replace(problem.rows, columns=described_rows(arm, problem.motions, moved, problem.friction))
    return with_effects(rows, arm, problem.arm, problem.motions, problem.friction, problem.base, moved)


def _instrumental(instruments: Array, columns: Array, torque: Array, weight: Array) -> Fit:
    """(Z^T W) beta = Z^T y of the weighted rows, scaled."""
    z, w, y = instruments * weight[:, None], columns * weight[:, None], torque * weight
    of_z = 1 / np.maximum(np.linalg.norm(z, axis=0), 1e-300)
    of_w = 1 / np.maximum(np.linalg.norm(w, axis=0), 1e-300)
    values = of_w * linalg.solve((z * of_z).T @ (w * of_w), (z * of_z).T @ y)
    return Fit(values, weight, torque - columns @ values, w * of_w)
