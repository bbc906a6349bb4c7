"""Targets of the tracker that were given with too small an uncertainty."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.estimated import Estimated, Settings
from identification.kinematics.estimation.map_estimation import Fit, fit, residuals
from identification.kinematics.estimation.outlier_pattern import OUTLIERS
from identification.kinematics.models.chain import Mask
from identification.kinematics.models.parameters import UNKNOWN_TARGET, Parameters, Target, parameters_of, target_of

_TARGET = 30.0
"""Twice the gain in log posterior by which a free target must be better: chi-square of 3, once in 1e6."""


def with_free_targets(estimated: Estimated) -> Estimated:
    """Targets given with too small an uncertainty are estimated instead, and said.

    The posterior of the fit with these targets free is compared with that of the targets as given, each with what the
    last link had to take: 2 log of their ratio is chi-square of 3 a target where they were given rightly.
    """
    targets, settings, as_given = estimated.targets, estimated.settings, estimated.fit
    if not any(target.given for target in targets):
        return estimated
    wide = [replace(target, std=UNKNOWN_TARGET) for target in targets]
    parameters = _parameters(estimated, wide)
    points = estimated.points.deflected(None)
    found = fit(parameters, points, start=as_given.values)
    both = found.inlier & as_given.inlier
    misfits = [
        _misfit(one, each, points, both, found.noise)
        for one, each in ((estimated.parameters, as_given), (parameters, found))
    ]
    gain = misfits[0] - misfits[1]
    more = int(found.inlier.sum()) - int(as_given.inlier.sum())
    if gain < _TARGET * sum(target.given for target in targets) and more <= OUTLIERS * len(points):
        return estimated
    chain = parameters.chain.at(found.values)
    places = [target_of(chain, k)[:3, 3] for k in range(len(targets))]
    off = [float(np.linalg.norm(place - one.place)) for place, one in zip(places, targets, strict=True)]
    wrong = [k for k, one in enumerate(targets) if one.given and off[k] >= 5.0 * one.std]
    if not wrong:
        return estimated
    freed = [wide[k] if k in wrong else one for k, one in enumerate(targets)]
    free = _parameters(estimated, freed)
    return replace(
        estimated,
        targets=tuple(freed),
        parameters=free,
        fit=fit(free, points, start=found.values),
        warnings=(*estimated.warnings, *(_sentence(settings, targets[k], places[k], off[k], gain) for k in wrong)),
    )


def _parameters(estimated: Estimated, targets: Sequence[Target]) -> Parameters:
    """Those of the estimate with other targets."""
    settings = estimated.settings
    return parameters_of(estimated.arm, targets, frame_known=estimated.frame_known, trust=settings.trust)


def _sentence(settings: Settings, target: Target, place: Array, off: float, gain: float) -> str:
    """That a target is at ``place`` (3,) m, ``off`` m from where it was given."""
    return (
        f"the target{target.name and ' ' + target.name} was given as ({_told(settings, target.place)}) m with "
        f"a standard deviation of {1e3 * target.std:g} mm, but the points place it at "
        f"({_told(settings, place)}) m, "
        f"{1e3 * off:.1f} mm away (chi-square {gain:.0f} with 3 degrees of freedom per target); "
        "it was estimated instead. Give --target in the frame of the last link, or a larger --target-std"
    )


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
