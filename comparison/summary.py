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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats

from arm_io.types import Array
from arm_report.numbers import value_and_two_std, with_two_std
from comparison.change import Change
from comparison.joint_fit.fewest_changes import AcceptedChange
from comparison.joint_fit.tested import Tested
from comparison.regression import Fitted, Structure

SIGNIFICANT = 1e-4
"""Probability by chance, of all candidates together, below which the changes of a cause are there."""
EXPLAINED = 2.5
"""Mean square of what a cause leaves of the changes that it can make, in deviations, up to which it explains them."""
SIGNIFICANT_STDS = 4.0
"""Deviations from zero that mass, or scale, must have."""
MARGIN = 9.0
"""Squares of deviations by which a scale must explain more than constant friction, which has as many parameters."""
DEPENDENT = 1e-6
"""Of the largest singular value: combinations of a body's parameters that no compared value shows."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """One cause that explains several changes.

    effect     payload, torque_constant (which a current gain is indistinguishable from), link_inertia, or an effect
               beyond the model
    joint      from 1; None: of the whole arm
    parameters name -> value, std, unit; of a torque constant its relative error, of a payload mass and centre; of the
               others the table has them
    explains   names of the significant changes that it makes
    """

    effect: str
    joint: int | None
    parameters: dict[str, tuple[float, float, str]]
    explains: tuple[str, ...]
    sentence: str

    def to_json(self) -> dict[str, Any]:
        """As compare.json has it."""
        return {
            "effect": self.effect,
            "joint": self.joint,
            "parameters": {
                name: {"value": value, "std": std, "unit": unit} for name, (value, std, unit) in self.parameters.items()
            },
            "explains": list(self.explains),
            "sentence": self.sentence,
        }


@dataclass(frozen=True)
class _Changes:
    """v compared values that every recording shows, of c: their places (v,), changes (v,), covariance, (v, v)."""

    places: NDArray[np.intp]
    quantities: Sequence[Change]
    change: Array
    covariance: Array

    def select(self, which: NDArray[np.bool_]) -> _Changes:
        return _Changes(
            self.places[which],
            [quantity for quantity, kept in zip(self.quantities, which) if kept],
            self.change[which],
            self.covariance[np.ix_(which, which)],
        )


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
        return list(_by_joint_fit(found, [*significant, *(one for one in added if one.significant)]))
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
    return [max(stated, key=lambda one: len(one.explains))] if stated else list(_by_joint_fit(found, of_all))


def _of_whole_arm(one: AcceptedChange) -> bool:
    added = one.tested.hypothesis.added
    return added is not None and (added.placed or added.timed)


def _seen(fits: Sequence[Fitted], is_before: NDArray[np.bool_], changes: Sequence[Change]) -> _Changes:
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
    return _Changes(places, [changes[int(k)] for k in places], change, covariance * widened[:, None] * widened)


@dataclass(frozen=True, kw_only=True)
class _Explanation:
    """Generalised least squares of v changes by the k columns of one cause.

    coefficients (k,), covariance (k, k)  of columns that the changes do not determine: 0, and a huge variance
    before, left  sum of the squared changes, in deviations, without the cause and with it
    rank          number of its independent columns
    changes       v
    """

    coefficients: Array
    covariance: Array
    before: float
    left: float
    rank: int
    changes: int

    @property
    def mean_left(self) -> float:
        """Mean square of what the cause leaves, in deviations: 1 if it explains all but chance."""
        return self.left / max(self.changes - self.rank, 1)

    def is_stated(self, candidates: int) -> bool:
        """Whether, of so many candidates, the changes of the cause are significant, and what it leaves is not."""
        chance = float(stats.chi2.sf((self.before - self.left) / max(self.mean_left, 1.0), self.rank))
        return candidates * chance < SIGNIFICANT and self.mean_left < EXPLAINED and self.changes > self.rank


def _explanation(x: Array, seen: _Changes) -> _Explanation:
    """The changes by the columns x (v, k) of a cause."""
    root = linalg.cholesky(seen.covariance + 1e-12 * np.diag(np.diag(seen.covariance)), lower=True)
    a = linalg.solve_triangular(root, x, lower=True)
    y = linalg.solve_triangular(root, seen.change, lower=True)
    size = np.linalg.norm(a, axis=0)
    size[size == 0.0] = 1.0
    u, s, vt = np.linalg.svd(a / size, full_matrices=False)
    independent = s > DEPENDENT * s[0]
    inverse = np.where(independent, 1.0 / np.maximum(s, 1e-300), 1e12) ** 2
    return _Explanation(
        coefficients=(vt[independent].T @ ((u[:, independent].T @ y) / s[independent])) / size,
        covariance=(vt.T * inverse) @ vt / np.outer(size, size),
        before=float(y @ y),
        left=float(np.sum((y - u[:, independent] @ (u[:, independent].T @ y)) ** 2)),
        rank=int(independent.sum()),
        changes=len(y),
    )


def _payload(structure: Structure, seen: _Changes, significant: Sequence[Change], candidates: int) -> Summary | None:
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
    by_body = _explanation(made[of_body], own)
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
            f"{_all(len(explains), len(significant))}"
        ),
    )


def _current_scale(
    joint: int,
    column: Array,
    seen: _Changes,
    significant: Sequence[Change],
    candidates: int,
    exact: Tested | None,
) -> Summary | None:
    """Another scale of a joint's currents (from 0), if it explains all that changed, and constant friction does not.

    exact: as the joint fit found it
    """
    by_scale = _explanation(column[seen.places][:, None], seen)
    if not by_scale.is_stated(candidates):
        return None
    curve = [
        float(quantity.quantity.kind == "curve" and quantity.quantity.joint == joint + 1)
        for quantity in seen.quantities
    ]
    by_friction = _explanation(np.array(curve)[:, None], seen)
    if (by_friction.mean_left - by_scale.mean_left) * (len(seen.change) - 1) < MARGIN:
        return None
    names = [one.quantity.name for one in significant]
    if exact is not None:
        return _scale_found(joint + 1, exact, names, 0)
    # the coefficient is the change over the value after, of which the value before is this share
    (coefficient,), before = by_scale.coefficients, 1.0 - float(by_scale.coefficients[0])
    scale, std = float(coefficient) / before, float(np.sqrt(by_scale.covariance[0, 0])) / before**2
    return _scale(joint + 1, scale, std, names, 0)


def _by_joint_fit(found: Sequence[AcceptedChange], significant: Sequence[Change]) -> Iterator[Summary]:
    """The causes among what the joint fit found that make several changes: scales, bodies, effects beyond the model."""
    of = [each.quantity for each in significant]
    for one in found:
        tested, joint = one.tested, one.tested.hypothesis.joint
        what, added = tested.hypothesis.what, tested.hypothesis.added
        if joint is None:
            names = [each.name for each in of if added is not None and each.name.startswith(f"{added.effect}.")]
            if added is not None and names:
                yield (_skew if added.timed else _tilt)(tested, names, len(of))
        elif what == "scale":
            names = [each.name for each in of if each.name in one.quantities or each.joint == joint]
            if (summary := _scale_found(joint, tested, names, len(of) - len(names))) is not None:
                yield summary
        elif added is not None:
            own = [each for each in of if each.name.startswith(f"joint{joint}.{added.effect}.")]
            names = [each.name for each in of if each in own or each.name in one.quantities]
            if own and len(names) > len(own):
                yield _cause(added.effect, joint, own[0].words, names, len(of))
        elif what == "inertia" and len(tested.coefficients) > 1:
            names = [each.name for each in of if each.name in one.quantities]
            if len(names) > 1:
                yield _cause("link_inertia", joint, f"body of link {joint}, or what it carries", names, len(of))


def _tilt(tested: Tested, explains: Sequence[str], of: int) -> Summary:
    """Another tilt of the base."""
    values, stds = tested.seen_by(tested.hypothesis.directions.T)
    roll, pitch = ((float(value), float(std), "rad") for value, std in zip(values, stds))
    size = float(np.hypot(*values))
    std = float(np.hypot(*(values * stds))) / max(size, 1e-300)
    shown = f"{with_two_std(1e3 * size, 1e3 * std)} mrad (roll {1e3 * values[0]:.3g}, pitch {1e3 * values[1]:.3g})"
    sentence = f"Base tilted by {shown}: explains {_all(len(explains), of)}"
    return Summary(
        effect="base_tilt",
        joint=None,
        parameters={"roll": roll, "pitch": pitch},
        explains=tuple(explains),
        sentence=sentence,
    )


def _skew(tested: Tested, explains: Sequence[str], of: int) -> Summary:
    """Another delay between currents and angles."""
    (delay,), (std,) = tested.seen_by(tested.hypothesis.directions.T)
    when = "later" if delay > 0.0 else "earlier"
    return Summary(
        effect="time_skew",
        joint=None,
        parameters={"delay": (float(delay), float(std), "s")},
        explains=tuple(explains),
        sentence=(
            f"Currents are read {with_two_std(1e3 * abs(delay), 1e3 * std)} ms {when} than before, relative to the "
            f"angles: explains {_all(len(explains), of)}"
        ),
    )


def _cause(effect: str, joint: int, words: str, explains: Sequence[str], of: int) -> Summary:
    """A cause whose value the table has."""
    sentence = f"{words[:1].upper()}{words[1:]}: explains {_all(len(explains), of)}"
    return Summary(effect=effect, joint=joint, parameters={}, explains=tuple(explains), sentence=sentence)


def _scale_found(joint: int, tested: Tested, explains: Sequence[str], others: int) -> Summary | None:
    """Another scale of the currents of a joint (from 1) as the joint fit has it."""
    unit = tested.hypothesis.directions.T
    (scale,), (std,) = tested.seen_by(unit)
    return _scale(joint, float(scale), float(std), explains, others)


def _scale(joint: int, scale: float, std: float, explains: Sequence[str], others: int) -> Summary | None:
    """Another scale of the currents of a joint (from 1), relative to those before."""
    if abs(scale) < SIGNIFICANT_STDS * std:
        return None
    constant = 1.0 / (1.0 + scale) - 1.0
    digits = max(0, 1 - int(np.floor(np.log10(max(200 * std, 1e-3)))))
    return Summary(
        effect="torque_constant",
        joint=joint,
        parameters={"error": (constant, std / (1.0 + scale) ** 2, "1")},
        explains=tuple(explains),
        sentence=(
            f"Currents of joint {joint} are {100 * scale:+.{digits}f} +- {200 * std:.{digits}f} % for the same torque "
            f"(torque constant {100 * constant:+.{digits}f} %, or the gain of its transducer): explains "
            f"{_all(len(explains), len(explains) + others)}"
        ),
    )


def _all(count: int, of: int) -> str:
    if count < of:
        return f"{count} of {of} significant changes"
    return "the only significant change" if count == 1 else f"all {count} significant changes"
