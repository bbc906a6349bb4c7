"""The search for what changed: the joint fit with effects that are always looked for, and ripples that stand out.

Currents that are read d later show the torque of d before. To first order this changes them by -d times the derivative
of the torque, which is a column of the joint fit (``SKEW``). Of milliseconds of a fast motion that is not enough, and
motions of the side after come with their torques put back by a delay that is known (``delays``). So that the
coefficient is still the whole delay, the column times the delay is added to their torques again: these are then late by
a delay whose effect is of first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from comparison.joint_fit.effect_columns import EffectColumns, with_columns
from comparison.joint_fit.effects import SKEW, Added, always
from comparison.joint_fit.hypotheses import Hypothesis, hypotheses, point_masses
from comparison.joint_fit.joint_regression import JointRegression, joint_regression
from comparison.joint_fit.ripples import ripples
from comparison.joint_fit.selection import selected, with_one_mass
from comparison.joint_fit.tested import Tested, residuals_of
from comparison.regression import Fitted, Rows, Structure
from identification.preprocessing.signals import Motion

FINER = tuple(2.0 ** (k / 4) for k in range(-4, 9))
"""Stiffnesses that are tried of an elastic gear that entered, over that at which it did: from half to four times. Where
its resonance with the link is near the band, what it does is not in proportion."""


@dataclass(frozen=True)
class Recorded:
    """The recordings in the band of the joint fit, and what each says alone.

    columns   of effects, of each
    is_before (n,) True for recordings of the side before
    drift  (c, d) as of ``friction_drift``
    delay  s by which the torques of the side after are put back
    """

    structure: Structure
    motions: Sequence[Motion]
    rows: Sequence[Rows]
    fits: Sequence[Fitted]
    columns: Sequence[EffectColumns]
    is_before: NDArray[np.bool_]
    drift: Array
    delay: float = 0.0


@dataclass(frozen=True)
class JointFit:
    """The joint fit with the columns of some effects beyond the model, its hypotheses, and those that entered.

    rows: of each recording, with these columns.
    """

    fit: JointRegression
    rows: Sequence[Rows]
    added: Sequence[Added]
    every: Sequence[Hypothesis]
    found: Sequence[Tested]


def searched(recorded: Recorded, joint: JointFit) -> JointFit:
    """The joint fit with the ripples that stand out of the residual without them, ``joint``.

    First those that all recordings have alike, then those that differ, without any change and with those found.
    """
    arm, motions, after = recorded.structure.arm, recorded.motions, ~recorded.is_before
    for common in (True, False):
        alternatives = [[], joint.found] if joint.found else [[]]
        residuals = [residuals_of(joint.fit, found) for found in alternatives]
        proposed = [one for e in residuals for one in ripples(arm, motions, e, after, common=common)]
        if proposed:
            joint = with_added(recorded, joint.rows, joint.added, proposed)
    return _without_rivals(recorded, joint)


def first_fit(recorded: Recorded) -> JointFit:
    """Without ripples."""
    first = always(recorded.structure.arm, recorded.motions)
    late = list(recorded.rows)
    for k in map(int, np.flatnonzero(~recorded.is_before & (recorded.delay != 0.0))):
        rate = recorded.columns[k].of([SKEW], recorded.motions[k].torque)[:, 0]
        late[k] = replace(late[k], y=late[k].y + recorded.delay * rate)
    return _with_finer_stiffnesses(recorded, with_added(recorded, late, [], first))


def _with_finer_stiffnesses(recorded: Recorded, joint: JointFit) -> JointFit:
    """Of each elastic gear that entered, the stiffness alone beside which the joint fit leaves least."""
    for soft in [one.hypothesis.added for one in joint.found]:
        if soft is None or not soft.elastic:
            continue
        others = [one for one in joint.added if not (one.elastic and one.joint == soft.joint)]
        kept = _columns_of(recorded, joint, others)
        rows = [replace(part, columns=part.columns[:, kept]) for part in joint.rows]
        tries = len(FINER) + sum(one.tries for one in joint.added) - sum(one.tries for one in others)
        tried = [replace(soft.stiffer(by), tries=tries) for by in FINER]
        best = tried[_likeliest(recorded, joint, rows, kept, tried)]
        joint = with_added(recorded, rows, others, [best])
    return joint


def _likeliest(
    recorded: Recorded, joint: JointFit, rows: Sequence[Rows], kept: Sequence[int], tried: Sequence[Added]
) -> int:
    """Which of some effects explains most, with its change, beside the changes that entered.

    rows: with the columns ``kept`` of those of ``joint``.
    """
    fit = _regression(recorded, _with_effects(recorded, rows, tried))
    # the columns of all recordings, those tried, and the joints' scales
    held = np.column_stack([np.empty((len(joint.fit.scale), 0)), *(one.hypothesis.directions for one in joint.found)])
    held = np.concatenate([held[kept], np.zeros((len(tried), held.shape[1])), held[-fit.scales :]]) / fit.scale[:, None]
    size = np.linalg.norm(held, axis=0)
    held = held[:, size > 0.0] / size[size > 0.0]
    explained = []
    for place in range(len(kept), len(kept) + len(tried)):
        columns = np.append(np.arange(len(kept)), place)
        changes = np.column_stack([held, np.eye(len(held))[place]])
        explained.append(fit.explained(columns, changes, fit.moment, fit.moment_after))
    return int(np.argmax(explained))


def _columns_of(recorded: Recorded, joint: JointFit, kept: Sequence[Added]) -> list[int]:
    """Columns of the rows of a joint fit without those of its effects beyond the model that are not ``kept``."""
    columns, first = list(range(recorded.structure.size)), recorded.structure.size
    for one in joint.added:
        places = range(first, first := first + len(one.units))
        columns += places if any(one is other for other in kept) else []
    return columns


def _without_rivals(recorded: Recorded, joint: JointFit) -> JointFit:
    """Without the ripples that are nearly those found, beside which nothing says how large these were before."""
    waves = [one.hypothesis.added for one in joint.found if one.hypothesis.added and one.hypothesis.added.wave]
    rivals = {k for k, one in enumerate(joint.added) if one not in waves and any(one.near(other) for other in waves)}
    if not rivals:
        return joint
    kept = [one for k, one in enumerate(joint.added) if k not in rivals]
    added = []
    for one in kept:
        # it was chosen among theirs, too
        more = sum(joint.added[k].tries for k in rivals if one in waves and joint.added[k].near(one))
        added.append(replace(one, tries=one.tries + more))
    columns = _columns_of(recorded, joint, kept)
    return with_added(recorded, [replace(part, columns=part.columns[:, columns]) for part in joint.rows], added, [])


def with_added(recorded: Recorded, rows: Sequence[Rows], added: Sequence[Added], proposed: Sequence[Added]) -> JointFit:
    """The joint fit of ``rows``, which have the columns of those ``added``, with those of the others ``proposed``."""
    new = [one for k, one in enumerate(proposed) if all(not one.same(other) for other in [*added, *proposed[:k]])]
    data, all_added = _with_effects(recorded, rows, new), [*added, *new]
    tried, points = hypotheses(recorded.structure, all_added), point_masses(recorded.structure, all_added)
    fit = _regression(recorded, data)
    found = with_one_mass(fit, tried, points, selected(fit, tried))
    return JointFit(fit, data, all_added, [*tried, *points], found)


def _with_effects(recorded: Recorded, rows: Sequence[Rows], more: Sequence[Added]) -> list[Rows]:
    """Rows with the columns of more effects."""
    recordings = zip(rows, recorded.columns, recorded.motions)
    return [with_columns(part, of_effects.of(more, motion.torque)) for part, of_effects, motion in recordings]


def _regression(recorded: Recorded, rows: Sequence[Rows]) -> JointRegression:
    return joint_regression(recorded.structure, rows, recorded.fits, recorded.is_before, recorded.drift)
