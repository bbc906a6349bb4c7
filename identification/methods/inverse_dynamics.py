"""Recordings -> the parameters of an arm, by linear regression on its inverse dynamics: the steps in order.

check -> smooth -> equations -> base parameters (``problem``) -> fit -> uncertainty -> prediction of held-out runs -> a
physically consistent arm (``conclusion``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Literal

from arm_io.types import Progress
from arm_model import Arm
from daq.recording import Recording
from identification.methods.free_friction import with_free_friction
from identification.methods.friction_trial import Trial
from identification.methods.load_and_temperature import Dependence
from identification.methods.solved import fitted_arm, friction_sizes, solved
from identification.regression.conclusion import conclude
from identification.regression.friction_band import bands_of
from identification.regression.least_squares import Method
from identification.regression.model_parameters import Friction
from identification.regression.problem import prepare
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
    joints whose friction is a curve in the model keep one, and ripples are looked for.
    """
    problem = prepare(fit, arm, held_out=held_out, friction=friction, progress=progress)
    found, trials, depends = solved(problem, method, progress), list[Trial](), list[Dependence]()
    ripples: list[Ripple] | None = None
    if shape != "straight":
        always = shape == "free"
        found, trials, depends = with_free_friction(found, method, always=always, progress=progress)
        ripples = find_ripples(found.problem, fitted_arm(found), friction_sizes(found.problem, found.best), progress)
        if stay := [one for one in ripples if one.stays]:
            found = solved(without_ripples(problem, stay), method, progress)
            found, trials, depends = with_free_friction(found, method, always=always, progress=progress)
    result = conclude(found.problem, method, found.best, found.spread, found.solve)
    result.notes.extend(held_note(found.held, len(found.problem.excited)))
    result.extra.update(held_directions=found.held, blocks=found.spread.blocks)
    result.extra["friction_trials"] = [asdict(trial) for trial in trials]
    result.extra["friction_dependence"] = [one.to_json() for one in depends]
    bands = bands_of(found.problem, result.arm, found.spread)
    result = replace(result, friction_bands=bands, smoothness=found.scale)
    return result if ripples is None else with_found(result, found.problem, ripples)
