"""What a plain fit says of the recordings themselves: dead channels, wrong signs, another unit than the model's."""

from __future__ import annotations

import numpy as np

from identification.conclusion.predictions import fit_residual
from identification.preprocessing import checks
from identification.regression.effect_columns import is_effect
from identification.regression.least_squares import Fit, least_squares
from identification.regression.model_parameters import model_values
from identification.regression.problem import Problem
from identification.regression.uncertainty import FitUncertainty, fit_uncertainty


def warnings_of_fit(problem: Problem) -> list[str]:
    """What plain least squares say of the recordings; InputError where an identification would refuse its fit."""
    rows = problem.rows
    columns, torque = rows.columns[:, problem.columns], rows.torque - problem.given_torque(rows)
    best = least_squares(columns, torque, rows.joint)
    check_friction(problem, best, fit_uncertainty(columns, rows, best))
    return unexplained_channels(problem, best)


def unexplained_channels(problem: Problem, best: Fit) -> list[str]:
    """Sentences on currents that hardly follow the motion of their joint; InputError where one does not at all."""
    # judged by the unconstrained fit, which follows the channel even if no possible arm does
    unconstrained, judged, found = fit_residual(problem, problem.judged, best), problem.judged, []
    torque = judged.torque if judged.rest is None else judged.torque - judged.rest
    level = (np.bincount(judged.joint, torque) / np.maximum(np.bincount(judged.joint), 1))[judged.joint]
    for number, recording in enumerate(problem.fit):
        here = judged.run == number
        rows = checks.FittedRows(
            residual=unconstrained[here],
            columns=judged.columns[here],
            torque=torque[here],
            level=level[here],
            joint=judged.joint[here],
        )
        sentences = checks.unexplained_channels(recording.path, rows, problem.arm)
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


def check_friction(problem: Problem, best: Fit, uncertainty: FitUncertainty) -> None:
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
