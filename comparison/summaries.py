"""Several changes as what one cause makes of them: a body at the flange, or another scale of one joint's currents.

A payload changes base parameters of several links at once; a torque constant or a current gain changes every parameter
that a joint's current shows, friction and masses alike. Both are linear in the compared values, to first order:

    payload         change = G p        G the grouping of base parameters, p the ten parameters of the last link; with
                                        the constant force at a joint that slides and bears it
    current scale   change = g A+ S y   A+ the regression, S y the torque of that joint alone

A cause is stated where the changes that it can make are significant together, and what it leaves of them is not. The
covariance of the changes has the deviations that each was judged by, and the correlations of the regressions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_report.numbers import value_and_two_std, with_two_std
from comparison.change import Change
from comparison.explanation import SeenChanges, explanation
from comparison.joint_fit.fewest_changes import AcceptedChange
from comparison.joint_fit.summaries import current_scale, scaled_currents, summaries_of_joint_fit
from comparison.joint_fit.tested import Tested
from comparison.regression import Fitted, Structure
from comparison.summary import SIGNIFICANT_STDS, Summary, of_significant

MARGIN = 9.0
"""Squares of deviations by which a scale must explain more than constant friction, which has as many parameters."""


def summaries(
    structure: Structure,
    fits: Sequence[Fitted],
    is_before: NDArray[np.bool_],
    changes: Sequence[Change],
    found: Sequence[AcceptedChange] = (),
    added: Sequence[Change] = (),
) -> list[Summary]:
    """The causes that sum up changes: of the regressions of single recordings, or those that the joint fit found.

    fits     of recordings that are long enough; of a side without one, what the joint fit found is summed up
    is_before  True of the fits before
    changes  of all quantities; the last of them are those of the values
    found    by the joint fit; added: changes of effects beyond the model
    """
    significant = [change for change in changes if change.significant]
    # tilt, encoder zeros and delays have no column in the regression of a single recording
    if any(_of_whole_arm(one) for one in found) or is_before.all() or not is_before.any():
        return list(summaries_of_joint_fit(found, [*significant, *(one for one in added if one.significant)]))
    seen = _seen(fits, is_before, changes[len(changes) - structure.size :])
    of_all = [*significant, *(one for one in added if one.significant)]
    if not len(seen.change) or not significant:
        return []
    candidates = 1 + len(structure.arm)
    single = [_payload(structure, seen, significant, candidates)]
    scale = np.mean([f.by_scale for f, mine in zip(fits, is_before) if not mine], axis=0)
    # what a scale does to the values differs between recordings, and so between means that are weighted otherwise
    several = found if len(fits) > 2 else []
    exact = {one.tested.hypothesis.joint: one.tested for one in several if one.tested.hypothesis.what == "scale"}
    scales = [
        _current_scale(joint, scale[:, joint], seen, significant, candidates, exact.get(joint + 1))
        for joint in range(len(structure.arm))
    ]
    # two joints whose scales explain as much cannot be distinguished
    single += scales if sum(one is not None for one in scales) == 1 else []
    stated = [one for one in single if one is not None]
    return [max(stated, key=lambda one: len(one.explains))] if stated else list(summaries_of_joint_fit(found, of_all))


def _of_whole_arm(one: AcceptedChange) -> bool:
    added = one.tested.hypothesis.added
    return added is not None and (added.placed or added.timed)


def _seen(fits: Sequence[Fitted], is_before: NDArray[np.bool_], changes: Sequence[Change]) -> SeenChanges:
    common = np.isfinite([f.values for f in fits]).all(axis=0) & np.array([one.std is not None for one in changes])
    places = np.flatnonzero(common)
    covariance = sum(
        np.mean([f.plain[np.ix_(places, places)] for f, mine in zip(fits, is_before) if mine == which], axis=0)
        / np.sum(is_before == which)
        for which in (True, False)
    )
    std = np.array([changes[int(k)].std or 0.0 for k in places])
    widened = std / np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    change = np.array([changes[int(k)].change or 0.0 for k in places])
    return SeenChanges(places, [changes[int(k)] for k in places], change, covariance * widened[:, None] * widened)


def _payload(structure: Structure, seen: SeenChanges, significant: Sequence[Change], candidates: int) -> Summary | None:
    """The body that was added to or taken from the last link, if it explains all changes of what it would change."""
    made = structure.by_body(len(structure.arm))[seen.places]
    of_links = np.array([quantity.quantity.kind == "inertia" for quantity in seen.quantities])
    of_body = np.asarray(made.any(axis=1) | of_links, bool)
    own = seen.select(of_body)
    names = {quantity.quantity.name for quantity in own.quantities}
    borne = {quantity.quantity.joint for quantity in own.quantities if quantity.quantity.kind == "curve"}
    # a constant force, of a joint that bears the body
    names |= {f"joint{joint}.offset" for joint in borne}
    explains = tuple(one.quantity.name for one in significant if one.quantity.name in names)
    if len(own.change) < 3 or not explains:
        return None
    by_body = explanation(made[of_body], own)
    c, std = by_body.coefficients, float(np.sqrt(by_body.covariance[0, 0]))
    if abs(c[0]) < SIGNIFICANT_STDS * std or not by_body.is_stated(candidates):
        return None
    parameters = {"mass": (float(c[0]), std, "kg")}
    for axis, moment, k in zip("xyz", c[1:4], range(1, 4)):
        slope = np.zeros(len(c))
        slope[0], slope[k] = -moment / c[0] ** 2, 1.0 / c[0]
        doubt = float(np.sqrt(slope @ by_body.covariance @ slope))
        if doubt < 0.5:
            parameters[axis] = (float(moment / c[0]), doubt, "m")
    verb = "more" if c[0] > 0 else "less"
    at = [f"{name} = {value_and_two_std(*parameters[name][:2])[0]}" for name in "xyz" if name in parameters]
    centre = ", ".join(at)
    where = f" at {centre} m of the last link" if centre else " at the last link"
    return Summary(
        effect="payload",
        joint=None,
        parameters=parameters,
        explains=explains,
        sentence=(
            f"A body of {with_two_std(abs(c[0]), std)} kg {verb}{where} (payload, or that link's own mass) explains "
            f"{of_significant(len(explains), len(significant))}"
        ),
    )


def _current_scale(
    joint: int,
    column: Array,
    seen: SeenChanges,
    significant: Sequence[Change],
    candidates: int,
    exact: Tested | None,
) -> Summary | None:
    """Another scale of a joint's currents (from 0), if it explains all that changed, and constant friction does not.

    exact: as the joint fit found it
    """
    by_scale = explanation(column[seen.places][:, None], seen)
    if not by_scale.is_stated(candidates):
        return None
    curve = [
        float(quantity.quantity.kind == "curve" and quantity.quantity.joint == joint + 1)
        for quantity in seen.quantities
    ]
    by_friction = explanation(np.array(curve)[:, None], seen)
    if (by_friction.mean_left - by_scale.mean_left) * (len(seen.change) - 1) < MARGIN:
        return None
    names = [one.quantity.name for one in significant]
    if exact is not None:
        return current_scale(joint + 1, exact, names, 0)
    # the coefficient is the change over the value after, of which the value before is this share
    (coefficient,), before = by_scale.coefficients, 1.0 - float(by_scale.coefficients[0])
    scale, std = float(coefficient) / before, float(np.sqrt(by_scale.covariance[0, 0])) / before**2
    return scaled_currents(joint + 1, scale, std, names, 0)
