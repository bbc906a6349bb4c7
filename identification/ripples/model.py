"""Ripples taken out of the torques of a regression, and put into what it finds.

The other parameters are fitted to torques without the ripples, which reach beyond their band; the model that is
written, its predictions and its uncertainty have both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE, Signals, values_of
from arm_model.tables import Uncertainty, uncertainty_of
from identification.preprocessing.signals import (
    Motion,
    equation_rows,
    equation_weight,
    parallel_filter,
    with_reversals,
)
from identification.regression.problem import Problem
from identification.result import Identification, Prediction, Value, unit_of
from identification.ripples.result import EFFECT, Ripple

CLEAR = 0.3
"""Standard deviation of a torque over its value below which it is identifiable; of an angle, rad."""


def without_ripples(problem: Problem, ripples: Sequence[Ripple]) -> Problem:
    """The problem with their torques subtracted from those measured."""

    def quiet(motions: Sequence[Motion]) -> list[Motion]:
        return [replace(one, torque=one.torque - ripple_torque(problem.arm, ripples, one)) for one in motions]

    def less(torque: Array, motions: Sequence[Motion]) -> Array:
        return np.asarray(torque - np.concatenate([_rows(problem.arm, ripples, motion) for motion in motions]))

    judged = less(problem.judged.torque, [with_reversals(motion) for motion in problem.motions])
    held = problem.held and replace(problem.held, torque=less(problem.held.torque, problem.held_motions))
    return replace(
        problem,
        rows=replace(problem.rows, torque=less(problem.rows.torque, problem.motions)),
        judged=replace(problem.judged, torque=judged),
        held=held,
        motions=quiet(problem.motions),
        held_motions=quiet(problem.held_motions),
    )


def ripple_torque(arm: Arm, ripples: Sequence[Ripple], motion: Motion) -> Array:
    """(m, J) N m (N) at the drives."""
    torque = np.zeros_like(motion.q)
    for one in ripples:
        j, effect = one.joint - 1, CATALOGUE[EFFECT]
        assert effect.torque is not None
        at = Signals(motor=arm.joints[j].ratio * motion.q[:, j])
        torque += np.outer(effect.torque(values_of(effect, one.term.parameters), at), arm.coupling_matrix[j])
    return torque


def _rows(arm: Arm, ripples: Sequence[Ripple], motion: Motion) -> Array:
    """(k,) N m (N) in the rows of a regression."""
    joint, row = np.nonzero(equation_rows(motion)[1].T)
    filtered = parallel_filter(motion, ripple_torque(arm, ripples, motion) * equation_weight(motion))
    return np.asarray(filtered[row, joint])


def with_found(result: Identification, problem: Problem, ripples: Sequence[Ripple]) -> Identification:
    """The result of a regression without the ripples, with those that stay in all that it says.

    problem: the one that was solved (``without_ripples``).
    """
    stay = [ripple for ripple in ripples if ripple.stays]
    result.extra["ripples"] = [ripple.to_json() for ripple in ripples]
    if not stay:
        return result
    given = [term.joint for term in result.arm.effects if term.name == EFFECT]
    names = _names(given, stay)
    arm = replace(result.arm, effects=(*result.arm.effects, *(one.term for one in stay)))
    known = arm.uncertainty and _wider(arm.uncertainty, names, stay)
    arm = replace(arm, uncertainty=known)
    motions = [with_reversals(motion) for motion in problem.motions], problem.held_motions or problem.motions
    seen = {
        (held, recording.path.name): with_reversals(motion)
        for held, files, of_files in zip((False, True), (problem.fit, problem.held_out or problem.fit), motions)
        for recording, motion in zip(files, of_files)
    }
    predictions = [_restored(one, problem.arm, stay, seen[one.held_out, one.run]) for one in result.predictions]
    values = [value for name, one in zip(names, stay) for value in _values(name, one, arm)]
    return replace(result, arm=arm, predictions=predictions, parameters=[*result.parameters, *values])


def _names(given: Sequence[int | None], ripples: Sequence[Ripple]) -> list[str]:
    """Of the effect at its joint: joint1.gear_ripple, joint1.gear_ripple2 (``arm_model.parameters``)."""
    count = {joint: given.count(joint) for joint in given}
    names = []
    for one in ripples:
        count[one.joint] = number = count.get(one.joint, 0) + 1
        names.append(f"joint{one.joint}.{EFFECT}{number if number > 1 else ''}")
    return names


def _wider(known: Uncertainty, names: Sequence[str], ripples: Sequence[Ripple]) -> Uncertainty:
    """What is known, with that of the ripples; next to no column of the arm resembles a wave, nor is correlated."""
    names_known = [*known.parameters, *(f"{name}.{entry}" for name in names for entry in ("torque", "order", "phase"))]
    covariance = linalg.block_diag(known.matrix, *(ripple.covariance for ripple in ripples))
    return uncertainty_of(known.file, tuple(names_known), covariance, known.left_over)


def _restored(one: Prediction, arm: Arm, ripples: Sequence[Ripple], motion: Motion) -> Prediction:
    """A prediction with the torque of the ripples on both sides again."""
    joint, row = np.nonzero(equation_rows(motion)[1].T)
    t, torque = equation_rows(motion)[0][row], _rows(arm, ripples, motion)
    added = np.zeros(len(one.t))
    for j in np.unique(one.joint):
        of_motion, of_prediction = joint == j, one.joint == j
        added[of_prediction] = torque[of_motion][np.searchsorted(t[of_motion], one.t[of_prediction])]
    return replace(one, measured=one.measured + added, predicted=one.predicted + added)


def _values(name: str, one: Ripple, arm: Arm) -> list[Value]:
    found = []
    for entry, value in one.term.parameters.items():
        std = one.std[entry]
        clear = std < CLEAR * (value if entry == "torque" else 1.0)
        exact = entry == "order" and bool(one.turn)
        if not exact:
            found.append(Value(f"{name}.{entry}", value, std, None, unit_of(f"{name}.{entry}", arm), clear))
    return found
