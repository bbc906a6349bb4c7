"""Stepwise selection of what changed: while one hypothesis is certain, that which explains most enters.

Those that chance explains beside it leave; and one mass may take the place of several changes that it explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from comparison.joint_fit.hypotheses import Hypothesis, chance
from comparison.joint_fit.joint_regression import JointRegression
from comparison.joint_fit.tested import Tested, residuals_of, shared_values, tested, tested_alone

SIGNIFICANT = 1e-3
"""Probability by chance, times the number of hypotheses, of a certain change; of one that explains more, its own."""
SLACK = 3.0
"""Deviations by which a value that cannot be negative may seem so."""
NEARLY = 0.2
"""Share of its change by which it may seem so, if that is more."""
STIFFER = 4.0
"""Deviations by which the stiffness of a spring must change, beside the constant torque that it may have."""
LAW = 0.25
"""Relative error to which an effect's law is trusted: stiffnesses and gaps stand at a few values, tilts and ripples are
small, and what they do is taken where the encoders say that the arm is."""
MOST = 6
"""Changes at most: an arm that differs in more is another arm."""
RIVAL_MARGIN = 6.0
"""Squares, in those of the noise, by which a rival of a change may explain less: a ratio of likelihoods of 20."""


def selected(fit: JointRegression, every: Sequence[Hypothesis], first: Sequence[Hypothesis] = ()) -> list[Tested]:
    """The hypotheses that entered, after those that are ``first``, each as tested beside the others that did.

    Of those that are certain, the one that explains most shows that something changed. What did is the hypothesis
    beside which it is not certain any more, if one explains still more and is not by chance: what a cause explains may
    be known less surely than a part of it. A certain one with fewer coefficients takes its place where that leaves
    nothing certain of it. The chance is that of the certain one. What may be the error of the law of an effect that
    entered is no change.
    """
    chosen = list(first)
    entered: list[Tested] = []
    surest: dict[int, float] = {}
    for _ in range(2 * MOST):
        rest = [one for one in every if all(one is not other for other in chosen)]
        likely = [
            one for one in tested(fit, rest, chosen) if one.log_p < np.log(SIGNIFICANT) and _is_possible(fit, one)
        ]
        likely = [one for one in likely if not _is_error_of(one, entered)]
        certain = [one for one in likely if _is_significant(one, every)]
        if len(chosen) == MOST or not certain:
            break
        shown = max(certain, key=_akaike_gain)
        explaining = _explaining(fit, every, chosen, shown, likely)
        best = _with_fewer_coefficients(fit, every, chosen, explaining, certain).hypothesis
        surest[id(best)] = shown.log_p
        entered = _conditional(fit, every, [*chosen, best])
        entered = [one for one in entered if one.log_p < np.log(SIGNIFICANT) and not _is_error_of(one, entered)]
        chosen = [one.hypothesis for one in entered]
    entered = _conditional(fit, every, chosen)
    return [replace(one, log_p=min(one.log_p, surest.get(id(one.hypothesis), 0.0))) for one in entered]


def with_one_mass(
    fit: JointRegression, every: Sequence[Hypothesis], points: Sequence[Hypothesis], found: Sequence[Tested]
) -> list[Tested]:
    """Those ``found``; or one of ``points`` and what is certain beside it, where that is fewer and explains more.

    A mass changes base parameters of several links, each of which another scale or a spring explains in part. It must
    be certain beside what enters with it: alone, what else changed would count as its noise. As in ``selected``, its
    chance is that of the surest of those found.
    """
    if len(found) < 2:
        return list(found)
    alone = [one for one in tested(fit, [*every, *points], []) if any(one.hypothesis is point for point in points)]
    if not alone:
        return list(found)
    point = max(alone, key=_akaike_gain).hypothesis
    others = selected(fit, [*every, point], [point])
    if any(one.hypothesis is point and chance(one.log_p, points) > np.log(SIGNIFICANT) for one in others):
        return list(found)
    if len(others) >= len(found) or akaike(fit, others) >= akaike(fit, found):
        return list(found)
    surest = min(one.log_p for one in found)
    return [replace(one, log_p=min(one.log_p, surest)) if one.hypothesis is point else one for one in others]


def rivals_of(fit: JointRegression, every: Sequence[Hypothesis], found: Sequence[Tested]) -> list[list[Tested]]:
    """Per change found, the hypotheses that explain as much in its place; those of which it is a part are none."""
    rivals = []
    for one in found:
        others = [each.hypothesis for each in found if each is not one]
        free = [each for each in every if all(each is not other for other in others)]
        rivals.append(
            [
                each
                for each in tested(fit, free, others)
                if each.hypothesis is not one.hypothesis
                and _akaike_gain(each) > _akaike_gain(one) - RIVAL_MARGIN
                and _is_possible(fit, each)
                and not _is_part(one.hypothesis, each.hypothesis)
            ]
        )
    return rivals


def _is_part(one: Hypothesis, of: Hypothesis) -> bool:
    """Whether a change is a special case of another."""
    within = of.directions @ np.linalg.lstsq(of.directions, one.directions, rcond=None)[0]
    return bool(np.allclose(within, one.directions, atol=1e-9 * np.abs(one.directions).max()))


def akaike(fit: JointRegression, found: Sequence[Tested]) -> float:
    """Akaike's criterion: squared residual over the noise with the changes ``found``, and 2 per coefficient."""
    squares = sum(float(np.sum(residual**2)) for residual in residuals_of(fit, found))
    return squares + 2 * sum(one.hypothesis.directions.shape[1] for one in found)


def _explaining(
    fit: JointRegression,
    every: Sequence[Hypothesis],
    chosen: Sequence[Hypothesis],
    shown: Tested,
    likely: Sequence[Tested],
) -> Tested:
    """Of those that explain more than the one ``shown``, the one that explains most and this one with it; or it."""
    rivals = [one for one in likely if _akaike_gain(one) > _akaike_gain(shown)]
    for rival in sorted(rivals, key=_akaike_gain, reverse=True):
        if not _certain_beside(fit, every, [*chosen, rival.hypothesis], shown.hypothesis):
            return rival
    return shown


def _with_fewer_coefficients(
    fit: JointRegression,
    every: Sequence[Hypothesis],
    chosen: Sequence[Hypothesis],
    best: Tested,
    certain: Sequence[Tested],
) -> Tested:
    """Of those ``certain`` with fewer coefficients beside which the ``best`` is not, the one that explains most; or it.

    A body has so many that it explains some of the noise of a short recording beside the friction that changed.
    """
    simpler = [one for one in certain if len(one.coefficients) < len(best.coefficients)]
    for one in sorted(simpler, key=_akaike_gain, reverse=True):
        if not _certain_beside(fit, every, [*chosen, one.hypothesis], best.hypothesis):
            return one
    return best


def _certain_beside(
    fit: JointRegression, every: Sequence[Hypothesis], given: Sequence[Hypothesis], one: Hypothesis
) -> bool:
    """Whether a hypothesis is significant conditional on those ``given``."""
    return any(_is_significant(each, every) for each in tested_alone(fit, one, every, given))


def _akaike_gain(one: Tested) -> float:
    """Reduction of Akaike's criterion: removed squares minus 2 per coefficient."""
    return one.gain - 2 * one.hypothesis.directions.shape[1]


def _is_significant(one: Tested, every: Sequence[Hypothesis]) -> bool:
    return bool(chance(one.log_p, every) < np.log(SIGNIFICANT))


def _is_error_of(one: Tested, entered: Sequence[Tested]) -> bool:
    """Whether a change explains no more than the possible error of the laws of accepted effects at its joint.

    A change of the whole arm: of those at any joint.
    """
    return any(
        other.hypothesis.added is not None
        and other.hypothesis is not one.hypothesis
        and (one.hypothesis.joint is None or other.hypothesis.joint in (None, one.hypothesis.joint))
        and one.gain < LAW**2 * other.gain
        for other in entered
    )


def _conditional(fit: JointRegression, every: Sequence[Hypothesis], chosen: Sequence[Hypothesis]) -> list[Tested]:
    """Each of those ``chosen``, tested conditional on the others."""
    again = []
    for one in chosen:
        others = [other for other in chosen if other is not one]
        again += tested_alone(fit, one, every, others)
    return again


def _is_possible(fit: JointRegression, one: Tested) -> bool:
    """Whether a change is physically admissible.

    Elasticity or gap of a gear must not be negative on either side. Of a spring at a joint the stiffness must have
    changed: its constant torque alone is a friction asymmetry.
    """
    added = one.hypothesis.added
    if added is None or added.wave or added.placed or added.timed:
        return True
    place = int(np.argmax(one.hypothesis.directions[:, 0]))
    if added.definition.spring is None:
        unit = np.eye(len(fit.scale))[place : place + 1]
        sizes, errors = one.seen_by(unit)
        return bool(abs(sizes[0]) > STIFFER * errors[0])
    values, covariance = shared_values(fit, np.zeros(len(fit.scale)), [one])
    least = min(values[place], values[place] + one.changes[place])
    return bool(least > -max(SLACK * np.sqrt(covariance[place, place]), NEARLY * abs(one.changes[place])))
