"""Recordings -> the parameters of an arm, by linear regression on its inverse dynamics: the steps in order.

check -> smooth -> equations -> base parameters (``problem``) -> fit -> uncertainty -> prediction of held-out runs -> a
physically consistent arm (``conclusion``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal

from arm_io.types import Progress
from arm_model import Arm
from daq.recording import Recording
from identification.conclusion.conclude import conclude
from identification.friction_band import bands_of
from identification.methods.chosen_terms import chosen_terms
from identification.methods.free_friction import with_free_friction
from identification.methods.friction_trial import FrictionTrial
from identification.methods.lag_of_currents import Lag, delayed, in_doubt, judged, lag_shown
from identification.methods.load_and_temperature import Dependence
from identification.methods.sign_velocity import SignVelocity, with_smaller_sign_velocities
from identification.methods.solution import Solution, fitted_arm, friction_sizes, solve
from identification.regression.least_squares import Method
from identification.regression.model_parameters import Friction
from identification.regression.problem import Problem, prepare
from identification.regression.weak_directions import held_note
from identification.result import Identification
from identification.ripples import Ripple, find_ripples, with_found, without_ripples

Shape = Literal["auto", "straight", "free"]
"""Friction over speed: a straight line, a curve, or whichever the held-out data justify, joint by joint."""


def identify(
    fit: Sequence[Recording],
    arm: Arm,
    *,
    held_out: Sequence[Recording] = (),
    method: Method = "wls",
    friction: Friction = "symmetric",
    shape: Shape = "auto",
    progress: Progress = lambda _: None,
) -> Identification:
    """Parameters of ``arm`` from recordings by least squares (``method`` ols, wls or irls), judged on ``held_out``.

    Without held-out recordings the first 70 % of the time predict the rest, and the result carries a warning. Raises
    InputError where the recordings are unusable. ``shape`` other than "straight":
    joints whose friction is a curve in the model keep one, and a lag of the currents and ripples are looked for.
    """

    def of(arm: Arm) -> _Fitted:
        problem = prepare(fit, arm, held_out=held_out, friction=friction, progress=progress)
        if shape == "straight":
            return _fitted(problem, method, shape, progress)
        problem, sign_velocities = with_smaller_sign_velocities(problem, method, progress)
        return replace(_fitted(problem, method, shape, progress), sign_velocities=sign_velocities)

    first = of(arm)
    lag, first = (None, first) if shape == "straight" else _with_lag(first, of, arm, method, progress)
    found, trials, depends = first.found, first.trials, first.depends
    ripples: list[Ripple] | None = None
    if shape != "straight":
        ripples = find_ripples(found.problem, fitted_arm(found), friction_sizes(found.problem, found.best), progress)
        if stay := [ripple for ripple in ripples if ripple.stays]:
            again = _fitted(without_ripples(first.problem, stay), method, shape, progress)
            found, trials, depends = again.found, again.trials, again.depends
    result = conclude(found.problem, method, found.best, found.uncertainty, found.solve)
    result.notes.extend(held_note(found.held, len(found.problem.excited)))
    result.extra.update(held_directions=found.held, blocks=found.uncertainty.blocks)
    result.extra["friction_trials"] = [asdict(trial) for trial in trials]
    result.extra["friction_dependence"] = [one.to_json() for one in depends]
    result.extra["sign_velocities"] = [one.to_json() for one in first.sign_velocities]
    if lag is not None:
        result.notes.append(lag.sentence(arm))
        result.extra["lag_of_currents"] = lag.to_json(arm)
    bands = bands_of(found.problem, result.arm, found.uncertainty)
    # with shape free, curves were not chosen by held-out rows
    chosen = chosen_terms(arm, lag, first.sign_velocities, [] if shape == "free" else trials, depends, ripples or [])
    result = replace(result, friction_bands=bands, smoothness=found.scale, chosen_on_held_out=chosen)
    return result if ripples is None else with_found(result, found.problem, ripples)


@dataclass(frozen=True)
class _Fitted:
    """The fit of a ``problem`` with the friction laws that are justified, and what was tried."""

    problem: Problem
    found: Solution
    trials: list[FrictionTrial]
    depends: list[Dependence]
    sign_velocities: Sequence[SignVelocity] = ()


def _fitted(problem: Problem, method: Method, shape: Shape, progress: Progress) -> _Fitted:
    found = solve(problem, method, progress)
    if shape == "straight":
        return _Fitted(problem, found, [], [])
    return _Fitted(problem, *with_free_friction(found, method, always=shape == "free", progress=progress))


def _with_lag(
    first: _Fitted, of: Callable[[Arm], _Fitted], arm: Arm, method: Method, progress: Progress
) -> tuple[Lag | None, _Fitted]:
    """The fit with the lag of the currents where one shows and is justified, and the lag that was tried.

    Where it is not justified the fit without it, whose deviations hold what the lag would change.
    """
    shown = lag_shown(first.found)
    if shown is None:
        return None, first
    second = of(delayed(arm, shown[0]))
    lag = judged(shown, first.found, second.found)
    if lag.stays:
        return lag, second
    found = solve(in_doubt(first.found.problem, lag), method, progress)
    return lag, replace(first, problem=in_doubt(first.problem, lag), found=found)
