"""The friction law of each joint: straight or curved over speed, constant or not over load and temperature.

Coulomb and viscous friction are a straight line over speed. A curve (``identification.regression.friction_shape``) is
tried at every joint that slides slowly and fast; it stays at the joints whose held-out error it reduces, by a share
that matters and in more blocks of time than chance allows. What depends on load and temperature
(``identification.methods.load_and_temperature``) is tried beside the curves, for one may hide the other.
"""

from __future__ import annotations

from dataclasses import replace

from arm_io.types import Progress
from identification.methods.friction_trial import FrictionTrial, trials_of
from identification.methods.held_out import cross_validated, held_out_residuals
from identification.methods.load_and_temperature import Dependence, with_load_and_temperature
from identification.methods.solution import Solution, fitted_arm, friction_sizes, solve
from identification.regression.conditional_friction import with_terms
from identification.regression.friction_shape import curve_speeds, with_curves
from identification.regression.least_squares import Method


def with_free_friction(
    straight: Solution, method: Method, *, always: bool, progress: Progress
) -> tuple[Solution, list[FrictionTrial], list[Dependence]]:
    """The fit with the friction laws that are justified, and all that was tried; ``always``: every curve that shows."""
    problem = straight.problem
    speeds = {
        j: found
        for j, joint in enumerate(problem.arm.joints)
        if joint.friction_curve is None and (found := curve_speeds(problem.motions, j)) is not None
    }
    progress("friction of free shape")
    curved = solve(with_curves(problem, speeds), method, progress) if speeds else straight
    wider, depends = with_load_and_temperature(curved, method, progress)
    if not speeds:
        return wider, [], depends
    added = wider.problem.arm.effects[len(problem.arm.effects) :]
    degc = {j: one.temperature for j, one in enumerate(wider.problem.arm.joints) if one.temperature is not None}
    if added:
        straight = solve(with_terms(problem, fitted_arm(straight), added, degc), method, progress)
    both, sizes = (straight, wider), friction_sizes(straight.problem, straight.best)
    slowest = {j: float(speed[0]) for j, speed in speeds.items()}
    trials = trials_of(held_out_residuals(*both), cross_validated(*both), slowest, sizes)
    trials = [replace(trial, stays=True) for trial in trials] if always else trials
    stay = {trial.joint - 1: speeds[trial.joint - 1] for trial in trials if trial.stays}
    if not stay:
        return straight, trials, depends
    if len(stay) < len(speeds):
        problem = with_curves(problem, stay)
        wider = solve(with_terms(problem, problem.arm, added, degc) if added else problem, method, progress)
    return wider, trials, depends
