"""Targets of the tracker that were given with too small an uncertainty."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from identification.kinematics.data.points import Points
from identification.kinematics.estimation.map_estimation import Fit, fit, residuals
from identification.kinematics.estimation.work import OUTLIERS, Settings, Work
from identification.kinematics.models.chain import Mask
from identification.kinematics.models.parameters import UNKNOWN_TARGET, Parameters, parameters_of, target_of

_TARGET = 30.0
"""Twice the gain in log posterior by which a free target must be better: chi-square of 3, once in 1e6."""


def free_targets(work: Work) -> None:
    """Targets given with too small an uncertainty are estimated instead, and said.

    The posterior of the fit with these targets free is compared with that of the targets as given, each with what the
    last link had to take: 2 log of their ratio is chi-square of 3 a target where they were given rightly.
    """
    if not any(target.given for target in work.targets):
        return
    wide = [replace(target, std=UNKNOWN_TARGET) for target in work.targets]
    settings = work.settings
    parameters = parameters_of(work.arm, wide, frame_known=settings.frame_known, trust=settings.trust)
    points = work.points.deflected(None)
    found = fit(parameters, points, start=work.estimate.values)
    both = found.inlier & work.estimate.inlier
    gain = _misfit(work.parameters, work.estimate, points, both, found.noise) - _misfit(
        parameters, found, points, both, found.noise
    )
    more = int(found.inlier.sum()) - int(work.estimate.inlier.sum())
    if gain < _TARGET * sum(target.given for target in work.targets) and more <= OUTLIERS * len(points):
        return
    chain = parameters.chain.at(found.values)
    found_at = [target_of(chain, k)[:3, 3] for k in range(len(work.targets))]
    off = [at - target.place for at, target in zip(found_at, work.targets, strict=True)]
    wrong = [k for k, one in enumerate(work.targets) if one.given and np.linalg.norm(off[k]) >= 5.0 * one.std]
    for k in wrong:
        one = work.targets[k]
        work.warnings.append(
            f"the target{one.name and ' ' + one.name} was given as ({_told(settings, one.place)}) m with "
            f"a standard deviation of {1e3 * one.std:g} mm, but the points place it at "
            f"({_told(settings, found_at[k])}) m, "
            f"{1e3 * np.linalg.norm(off[k]):.1f} mm away (chi-square {gain:.0f} with 3 degrees of freedom per target); "
            "it was estimated instead. Give --target in the frame of the last link, or a larger --target-std"
        )
    if wrong:
        work.targets = [wide[k] if k in wrong else one for k, one in enumerate(work.targets)]
        work.parameters = parameters_of(work.arm, work.targets, frame_known=settings.frame_known, trust=settings.trust)
        work.estimate = fit(work.parameters, points, start=found.values)


def _told(settings: Settings, place: Iterable[float]) -> str:
    """A place (3,) m in the arm's last link, as text in the last link of the user's model."""
    there = np.linalg.solve(settings.last_link, [*place, 1.0])
    return ", ".join(f"{v:.4f}" for v in there[:3])


def _misfit(parameters: Parameters, found: Fit, points: Points, rows: Mask, noise: float) -> float:
    """Squared deviations of the points and of the priors."""
    off = residuals(parameters, found.values, found.extension, points)[rows]
    free = parameters.free
    prior = (found.values - parameters.chain.values)[free] / parameters.scale[free]
    return float(np.sum(off**2) / noise**2 + np.sum(prior**2))
