"""Recordings -> the parameters of an arm, by linear regression on its inverse dynamics: the steps in order.

check -> smooth -> equations -> base parameters (``problem``) -> fit -> uncertainty -> prediction of held-out runs -> a
physically consistent arm (``conclusion``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm
from daq.recording import Recording
from identification.regression.conclusion import conclude, physical_values, with_values
from identification.regression.equations import Equations, Friction, model_values, shown_rows
from identification.regression.least_squares import Fit, Method, least_squares
from identification.regression.problem import Problem, prepare
from identification.regression.uncertainty import uncertainty
from identification.regression.weak_directions import held_note, held_to_the_model
from identification.result import Identification

# Gauss-Newton steps of an arm with effects, at most; a step of fewer standard deviations is the last.
STEPS, SETTLED = 8, 0.1
SHORTEST = 1 / 16  # of a step


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

    Without held-out recordings the first 70 % of the time predict the rest, and the result carries a warning. Raises
    InputError where the recordings are unusable.
    """
    problem = prepare(fit, arm, held_out=held_out, friction=friction, progress=progress)

    def solve(rows: Equations) -> Fit:
        return least_squares(rows.columns[:, problem.columns], rows.torque - problem.given(rows), rows.joint, method)

    values, before, held = model_values(arm, friction), None, 0
    for number in range(STEPS if arm.effects else 1):
        progress(f"least squares, step {number + 1}" if arm.effects else "least squares")
        best = solve(problem.rows)
        progress("uncertainty")
        spread = uncertainty(problem.rows.columns[:, problem.columns], problem.rows, best)
        if method != "ols":  # which is the textbook's
            best, held = held_to_the_model(problem, best, spread.information)
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
    result = conclude(problem, method, best, spread, solve)
    result.notes.extend(held_note(held, len(problem.excited)))
    result.extra.update(held_directions=held, blocks=spread.blocks)
    return result


def _towards(problem: Problem, now: Array, wanted: Array, fit: Fit) -> Array:
    """As far from the parameters ``now`` (p,) towards ``wanted`` as the arm shows the torques better.

    A line search by halves.

    Both are consistent arms, and so is all that lies between.
    """

    def cost(values: Array) -> float:
        shown = shown_rows(with_values(problem, values), problem.arm, problem.motions)
        return float(np.sum((fit.weight * (problem.rows.torque - shown)) ** 2))

    least, length = cost(now), 1.0
    while cost(now + length * (wanted - now)) > least and length > SHORTEST:
        length /= 2
    return now + length * (wanted - now)
