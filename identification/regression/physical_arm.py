"""The arm of a fit: the physically consistent one nearest to it, as a model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, with_parameters
from arm_model.effects import driven
from arm_model.friction_split import completed
from arm_model.servo import fixed_gains
from identification.regression.friction_rows import friction_rows
from identification.regression.least_squares import Fit
from identification.regression.model_parameters import freed_rotors, lifted_masses, lifts, model_values
from identification.regression.physical_consistency import BaseFit, Prior, consistent_parameters
from identification.regression.problem import Problem

OF_WEIGHT = 0.1
"""Of what a joint lifts: an offset of this share of its weight is as far from the model as a mass twice as large, and a
rotor of this share is what the model has none of."""


def physical_values(problem: Problem, fit: Fit, information: Array) -> Array:
    """(p,) standard parameters of the physically consistent arm nearest to a fit.

    ``information`` (b, b) is that by the noise of the rows (``FitUncertainty.of_rows``), so that the arm predicts them
    nearly as the fit does. Systematic errors are in the deviations of the fit: no reason to predict the rows worse.

    Of a joint that lifts, gravity's constant force is taken for mass and what else is accelerated for a rotor. Of
    others, a rotor that the model has none of is what the fit has beyond the model's links: else a link would take it,
    two times too heavy, which no motion shows but a tilt of the base would.
    """
    names = problem.base.names
    grouping = problem.base.grouping[problem.excited]
    near, scale = model_values(problem.arm, problem.friction), np.zeros(len(names))
    beyond = fit.values - grouping @ near
    lifted = lifted_masses(problem.arm)
    for number in freed_rotors(problem.arm):
        rotor = names.index(f"joint{number}.rotor_inertia")
        shares = grouping[:, rotor]
        if np.any(shares):
            inertia = float(shares @ beyond / (shares @ shares))
            near[rotor] = OF_WEIGHT * lifted[number - 1] if lifted[number - 1] else max(inertia, 0.0)
    for j, mass in enumerate(lifted):
        if mass and (offset := f"joint{j + 1}.offset") in names:
            scale[names.index(offset)] = OF_WEIGHT * mass * float(np.linalg.norm(problem.arm.gravity))
    prior = Prior(names, near, friction_rows(problem.arm, names, problem.top_speeds), scale)
    return consistent_parameters(BaseFit(grouping, fit.values, information), prior)


def with_values(problem: Problem, physical: Array) -> Arm:
    """The arm with standard parameters ``physical`` (p,).

    Where the model's Coulomb friction differs by direction, what symmetric friction calls an offset stays such a
    difference: while a joint moves the two are one, but at rest an offset is a torque and a difference is none.
    """
    values = dict(zip(problem.base.names, map(float, physical)))
    if problem.friction == "asymmetric":  # the two magnitudes include the offset
        values |= {f"joint{j}.offset": 0.0 for j in range(1, len(problem.arm) + 1)}
    # servo gains that follow from the model's inertia must stay as they are: the real servo did not change
    even = with_parameters(fixed_gains(problem.arm), values)
    even = replace(even, joints=tuple(map(completed, even.joints)))
    if problem.friction == "asymmetric":
        return even
    now = dict(zip(problem.base.names, model_values(problem.arm, problem.friction)))
    for j, joint in enumerate(problem.arm.joints):
        if joint.coulomb[0] == joint.coulomb[1]:
            continue
        name = f"joint{j + 1}.coulomb"
        difference, offset = joint.ratio * (joint.coulomb[0] - joint.coulomb[1]) / 2, joint.ratio * joint.offset
        change = values[f"joint{j + 1}.offset"] - now[f"joint{j + 1}.offset"]
        if lifts(problem.arm, j):
            offset += change
        else:
            difference += change
        sides = {f"{name}_positive": values[name] + difference, f"{name}_negative": values[name] - difference}
        uneven = with_parameters(even, {**sides, f"joint{j + 1}.offset": offset})
        even = even if j in driven(uneven, problem.top_speeds) else uneven
    return even
