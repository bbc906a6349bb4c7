"""Which parameters these runs determine, by the information in them: values, deviations, and why the others are not.

A parameter counts as identifiable if its standard deviation is small beside its value; or, for a value near zero,
beside the size that such a parameter has, provided that no joint's torque is more uncertain by it than a trace. The
second condition alone would call a parameter identifiable whose effect on these runs is small, however little is known
of it: a wrist coupling of -0.03 +- 11 in front of a link of 0.1 kg.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import parameter
from identification.regression.effect_columns import definition, is_effect
from identification.regression.least_squares import Fit
from identification.regression.model_parameters import model_values
from identification.regression.problem import Problem
from identification.regression.uncertainty import FitUncertainty
from identification.result import Value, unit_of

IDENTIFIABLE = 0.3
"""Of the value, or of the size that such a parameter has: a larger standard deviation is not identifiable."""
TRACE = 0.02
"""Of a joint's rms torque: more uncertainty than this is more than a trace."""
LEAST = 0.1
"""Of the largest of its unit: the size of a parameter that the model has as nothing."""


def base_and_standard_values(
    problem: Problem, best: Fit, uncertainty: FitUncertainty, physical: Array
) -> tuple[list[Value], list[Value]]:
    """Excited base parameters with their uncertainty, and all standard parameters.

    Of the latter those that stand alone in a base parameter have its value, the others that of the physically
    consistent arm ``physical`` (p,), and the reason why.
    """
    estimated = _estimated(problem, best, uncertainty)
    base = problem.base
    standing = {int(base.kept[row]): int(row) for row in range(len(base))}
    parameters = []
    for column, name in enumerate(base.names):
        row = standing.get(column)
        if row is not None and row in estimated and base.alone(row):
            parameters.append(replace(estimated[row], name=name))
            continue
        why, from_model = _reason(problem, column, None if row is None or row in estimated else row)
        value_now = parameter(problem.arm, name) if from_model else float(physical[column])
        parameters.append(Value(name, value_now, None, None, unit_of(name, problem.arm), False, why))
    return [estimated[int(row)] for row in problem.excited], parameters


def _estimated(problem: Problem, best: Fit, uncertainty: FitUncertainty) -> dict[int, Value]:
    """Excited base parameters by their row among all."""
    base, sizes = problem.base, _sizes(problem, best)
    estimated: dict[int, Value] = {}
    for k, row in enumerate(problem.excited):
        column, std = int(base.kept[row]), float(uncertainty.std[k])
        small = std <= IDENTIFIABLE * sizes[k] and not _matters(problem, column, std)
        certain = std <= IDENTIFIABLE * abs(best.values[k]) or small
        why = "" if certain else f"known to {std:.2g} only: these runs excite it too little"
        estimated[int(row)] = Value(
            base.expression(int(row)),
            float(best.values[k]),
            std,
            float(uncertainty.std_formula[k]),
            unit_of(base.names[column], problem.arm),
            bool(certain),
            why,
            float(uncertainty.std_bootstrap[k]),
        )
    return estimated


def _matters(problem: Problem, column: int, std: float) -> bool:
    """Whether the torque of any joint is more uncertain by a parameter than a trace."""
    rows = problem.rows
    for j in np.unique(rows.joint):
        of_joint = rows.joint == j
        torque_std = std * float(np.sqrt(np.mean(rows.columns[of_joint, column] ** 2)))
        if torque_std > TRACE * float(np.sqrt(np.mean(rows.torque[of_joint] ** 2))):
            return True
    return False


def _sizes(problem: Problem, best: Fit) -> Array:
    """(b,) sizes that the excited base parameters have: of effects the catalogue's, of others the model's or the fit's.

    That is the sum of the magnitudes that are added up in it, and at least LEAST of the largest of its unit.
    """
    model = np.abs(problem.base.grouping[problem.excited]) @ np.abs(model_values(problem.arm, problem.friction))
    size = np.maximum(model, np.abs(best.values))
    names = [problem.base.names[column] for column in problem.columns]
    units = np.array([unit_of(name, problem.arm) for name in names])
    effects = np.array([is_effect(name) for name in names], bool)
    for unit in set(units):
        of_unit = (units == unit) & ~effects
        size[of_unit] = np.maximum(model[of_unit], LEAST * size[of_unit].max(initial=0.0))
    for k in np.flatnonzero(effects):
        low, high = definition(names[k]).typical
        size[k] = float(np.sqrt(max(low, LEAST**2 * high) * high))
    return np.asarray(size)


def _reason(problem: Problem, column: int, silent: int | None) -> tuple[str, bool]:
    """Why a standard parameter has no value of its own, and whether the model's stays to the last digit.

    ``silent``: its row among the base parameters, where the runs do not excite it.
    """
    name = problem.base.names[column]
    joint = name.partition(".")[0]
    resting = joint not in {f"joint{j + 1}" for j in problem.rows.joint}
    if silent is not None and joint.startswith("joint") and resting and not is_effect(name):
        return (
            f"{joint} rests: stiction balances any torque up to its limit, and conceals offset and rotor; value of the "
            "model",
            True,
        )
    if silent is not None:
        return f"not excited by these runs; {_origin(problem, name)}", False
    if np.any(problem.base.grouping[:, column] != 0):
        return (
            "only in combination with others (base_parameters); this value is that of the physically consistent arm "
            "nearest to the model",
            False,
        )
    return f"changes no torque of this arm, whatever its other parameters; {_origin(problem, name)}", False


def _origin(problem: Problem, name: str) -> str:
    """Where a value that the data do not determine comes from."""
    link = re.fullmatch(r"link(\d+)\.(mass|m[xyz]|i[xyz]{2})", name)
    if link is not None and problem.arm.joints[int(link[1]) - 1].mass <= 0.0:
        return "value of a small body, which a link without mass in the model gets here"
    return "value of the model"
