"""The result of a fit: predictions, named parameters with uncertainty, a physically consistent arm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from arm_io import counted
from identification.conclusion.channel_checks import check_friction, unexplained_channels
from identification.conclusion.predictions import accounted_for, all_predictions
from identification.preprocessing.attenuation import attenuation_warnings
from identification.regression.equations import Equations
from identification.regression.identifiability import base_and_standard_values
from identification.regression.least_squares import Fit
from identification.regression.parameter_covariance import known_to
from identification.regression.physical_arm import physical_values, with_values
from identification.regression.problem import Problem
from identification.regression.uncertainty import FitUncertainty
from identification.result import Identification

MOST_NAMED = 6
"""Weak parameters in a warning."""
UNBIASED = ("iv", "didim")
"""Methods whose regressors have no noise of the encoders."""
UNCONSTRAINED = "least squares alone, not physically consistent"
"""Name of the fit itself beside the arm that is written."""


def conclude(
    problem: Problem, method: str, best: Fit, uncertainty: FitUncertainty, solve: Callable[[Equations], Fit]
) -> Identification:
    """The result of a fit: predictions, named parameters, a consistent arm.

    ``solve`` refits a part of the rows, for the error of the split by time.
    """
    check_friction(problem, best, uncertainty)
    warnings = list(problem.warnings)
    if method not in UNBIASED:
        warnings += attenuation_warnings(problem.motions)
    physical = physical_values(problem, best, uncertainty.of_rows)
    identified = with_values(problem, physical)
    predictions, compared, held_names = all_predictions(problem, best, identified, uncertainty, solve, warnings)
    warnings += unexplained_channels(problem, best)
    predictions = accounted_for(problem, predictions, identified, uncertainty)
    identified = replace(identified, uncertainty=known_to(problem, uncertainty))
    base, parameters = base_and_standard_values(problem, best, uncertainty, physical)
    if weak := [value.name for value in base if not value.identifiable]:
        warnings.append(
            f"{len(weak)} of {len(base)} base parameters cannot be identified from these runs: {_weak_in_words(weak)}"
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
        notes=list(_notes(problem, uncertainty)),
        bands=[motion.band for motion in problem.motions],
        covariance=uncertainty.covariance,
        compared={UNCONSTRAINED: compared},
        runs=problem.runs,
    )


def _notes(problem: Problem, uncertainty: FitUncertainty) -> Iterator[str]:
    """Bands and blocks that the fit was made with."""
    for recording, motion in zip(problem.fit, problem.motions):
        yield (
            f"cut-off {motion.band.motion:.3g} Hz for differentiation, {motion.band.parallel:.3g} Hz for the "
            f"regression, from the spectrum of {recording.path.name}"
        )
    yield (
        f"standard deviations from {uncertainty.blocks} blocks of {uncertainty.block:.3g} s; those of the textbook "
        "formula assume white residuals"
    )


def _weak_in_words(names: Sequence[str]) -> str:
    """The first of the names; of friction curves only how many of a joint's speeds they are."""
    speeds = Counter(name.partition(".")[0].removeprefix("joint") for name in names if ".curve" in name)
    others = [name for name in names if ".curve" not in name]
    listed = [*others[:MOST_NAMED], *["..."] * (len(others) > MOST_NAMED)]
    curves = [f"friction of joint {j} at {counted(n, 'speed')} of its curve" for j, n in speeds.items()]
    return ", ".join([*listed, *curves])
