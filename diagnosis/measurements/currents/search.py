"""The search for causes: rounds of forward selection, each followed by deletion and by the exact model of what was accepted.

Columns are first order in their effects. After every round the model extended by the accepted causes is evaluated exactly
(``diagnosis.residual.expected_current``), and what its first-order columns had wrong is taken out of the data (deferred correction: Stetter, Numerische
Mathematik 29, 1978), so that it is not taken for another cause. Linear algebra stays as it is; its solution is that of the exact model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm, EffectTerm
from arm_model.effects import CATALOGUE, same_columns
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.design_matrix import Columns, Side, columns_of, side_with
from diagnosis.measurements.currents.estimates import physical, sharpened
from diagnosis.measurements.currents.pairs import two_of
from diagnosis.measurements.currents.ripple_orders import audible, order_of
from diagnosis.measurements.currents.unexplained import (
    DEAFENING,
    Remainder,
    beside,
    better_than_causes,
    loud,
    structure_left,
)
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.regression import (
    SHARE_OF_NOISE,
    Accepted,
    Look,
    Pair,
    accept,
    look,
    matters,
    round_of,
    shadows,
    simplest,
)

MOST_CAUSES = 8
CORRECTIONS = 2
"""Evaluations of the exact model a round: the second-order part of a strong effect is a tenth of it, that of the rest a hundredth."""

WORSE = 1.1
"""Times the first-order residual: an exact model that leaves more is outside of its range."""
MANY, MAKESHIFT = 6, 1.5
"""Several causes of a joint with so many coefficients together are the makeshift for one function of one variable that leaves but a fifth more than
they do; and four or more that mostly cancel one another (``_cancelling``; what is there adds up, hidden triples to 1.0) for one that explains nine
tenths of what they do."""
SUPERFLUOUS = 0.5
"""A cause that keeps less than this share of its gain beside unexplained structure was a name for part of that structure."""


@dataclass(frozen=True)
class Problem:
    """What is searched: both sides' residuals under the model as given, all candidates' columns, and those that are always free."""

    arm: Arm
    sides: tuple[Side, Side]
    library: dict[Candidate, Pair]
    free: list[Pair]
    lines: tuple[Candidate, ...] = ()  # ripples, whose columns are computed where they can be heard

    def listen(self, residual: Array) -> None:
        """Puts the ripples that can be heard in the fitted side's whitened residual into the library."""
        highest = max((order_of(c) or 0 for c in self.lines), default=0)
        for joint in sorted({c.joint for c in self.lines if c.joint}):
            orders = audible(self.sides[0], residual, self.arm, joint, highest)
            for c in self.lines:
                if c.joint == joint and order_of(c) in orders and c not in self.library:
                    self.library[c] = columns_of(c, self.sides[0], self.arm), columns_of(c, self.sides[1], self.arm)

    def accepted(self, chosen: Sequence[Candidate], sides: tuple[Side, Side]) -> Accepted:
        """The chosen candidates fitted together to ``sides``; the free columns' coefficients come first."""
        return accept(*sides, self.free + [self.library[c] for c in chosen])

    def parts(self, chosen: Sequence[Candidate], accepted: Accepted) -> list[Array]:
        """The coefficients (k,) of each chosen candidate."""
        widths = [self.library[c][0].x.shape[1] for c in chosen]
        return np.split(accepted.coefficients[len(self.free) :], np.cumsum(widths)[:-1]) if chosen else []


@dataclass(frozen=True)
class Found:
    """Chosen candidates in the order of acceptance; for each, those that would have done as well; residuals less what is of second order."""

    chosen: list[Candidate]
    equals: list[list[Look]]
    sides: tuple[Side, Side]
    remainder: Remainder


def search(problem: Problem, progress: Callable[[str], None], banned: Set[EffectKey] = frozenset()) -> Found:
    """Candidates that explain the residual together; none of ``banned``, effect and joint."""
    sides, chosen = problem.sides, list[Candidate]()
    equals: dict[EffectKey, list[Look]] = {}
    for number in range(1, MOST_CAUSES + 1):
        progress(f"looking for cause {number}")
        accepted = problem.accepted(chosen, sides)
        problem.listen(accepted.fit)
        taken = _taken(chosen) | banned
        able = round_of(problem.library, accepted, *sides, taken, physical)
        entering: Sequence[Candidate]
        if able:
            best, alike = simplest(able, sides[1])
            sharp = sharpened(best.candidate, accepted, sides[0], problem.arm)
            problem.library[sharp] = columns_of(sharp, sides[0], problem.arm), columns_of(sharp, sides[1], problem.arm)
            equals[sharp.key], entering = alike, [sharp]
        else:  # two effects that hide each other may enter together
            entering = two_of(problem.library, accepted, *sides, loud(accepted, sides[1], problem.arm), taken, physical)
            equals |= {c.key: [look(c, problem.library[c], accepted, sides[1])] for c in entering}
        before, chosen = chosen, weeded([*chosen, *entering], problem, sides)
        if set(chosen) == set(before):
            break
        sides = corrected(chosen, problem, sides)
    better = polished(chosen, problem, sides)
    if better is not chosen:
        chosen, sides = better, corrected(better, problem, problem.sides)
    chosen, sides = simplified(chosen, problem, sides, equals, banned)
    if len(fewer := weeded(chosen, problem, sides)) < len(chosen):
        chosen, sides = fewer, corrected(fewer, problem, problem.sides)
    progress("looking at what is left")
    remainder = structure_left(*sides, problem.accepted(chosen, sides), problem.arm)
    while dissolved := _superfluous(chosen, problem, sides, remainder) or _outdone(chosen, problem, sides):
        chosen = [c for c in chosen if c not in dissolved]
        sides = corrected(chosen, problem, sides)
        remainder = structure_left(*sides, problem.accepted(chosen, sides), problem.arm)
    return Found(chosen, [equals[c.key] for c in chosen], sides, remainder)


def _taken(chosen: Sequence[Candidate]) -> set[EffectKey]:
    """The chosen, and their twins: both together would explain anything, as their difference is the residual itself."""
    return {c.key for c in chosen} | {(other, c.joint) for c in chosen for other in same_columns(c.definition)}


def without(found: Found, gone: Candidate, problem: Problem) -> Found:
    """What was found, less one candidate; the others fitted anew."""
    kept = [(c, alike) for c, alike in zip(found.chosen, found.equals) if c is not gone]
    chosen = [c for c, _ in kept]
    sides = corrected(chosen, problem, problem.sides) if chosen else problem.sides
    remainder = structure_left(*sides, problem.accepted(chosen, sides), problem.arm)
    return Found(chosen, [alike for _, alike in kept], sides, remainder)


def _superfluous(
    chosen: Sequence[Candidate], problem: Problem, sides: tuple[Side, Side], remainder: Remainder
) -> list[Candidate]:
    """The cause that unexplained structure beside all causes makes superfluous most, if there is one.

    Where what is left hangs on nothing known and is far from noise, a cause that explains less than that was a name for part of it.
    """
    shares = {}
    unknown = {
        one.joint for one in remainder.structures if not one.share
    }  # joints where something is left that hangs on nothing known
    for c in chosen:
        others = problem.accepted([o for o in chosen if o is not c], sides)
        touching = [pair for pair in remainder.pairs if _meet(pair[0], problem.library[c][0])]
        if touching:
            alone = look(c, problem.library[c], others, sides[1]).held_out_gain
            shares[c] = look(c, problem.library[c], beside(others, touching), sides[1]).held_out_gain / alone
        elif c.joint is not None and c.joint in unknown:
            rows = sides[1].of(c.joint)
            left = float(np.sum(problem.accepted(chosen, sides).held_out[rows] ** 2))
            if left > DEAFENING**2 * sides[1].rows:
                shares[c] = SUPERFLUOUS * look(c, problem.library[c], others, sides[1]).held_out_gain / left
    least = min(shares, key=lambda c: shares[c], default=None)
    return [least] if least is not None and shares[least] < SUPERFLUOUS else []


def _outdone(chosen: Sequence[Candidate], problem: Problem, sides: tuple[Side, Side]) -> list[Candidate]:
    """The causes of a joint that a function of one variable explains better than all of them together."""
    having = problem.accepted(chosen, sides)
    for joint in sorted({c.joint for c in chosen if c.joint}):
        own = [c for c in chosen if c.joint == joint]
        without = problem.accepted([c for c in chosen if c not in own], sides)
        before, left = (float(np.sum(one.held_out[sides[1].of(joint)] ** 2)) for one in (without, having))
        allowed = 0.0
        if len(own) > 1 and sum(problem.library[c][0].x.shape[1] for c in own) >= MANY:
            allowed = 0.2 * left
        if len(own) > 3 and _cancelling(own, chosen, problem, having) > MAKESHIFT:
            allowed = max(allowed, 0.1 * (before - left))
        if better_than_causes(*sides, without, having, problem.arm, joint, allowed):
            return own
    return []


def _cancelling(own: Sequence[Candidate], chosen: Sequence[Candidate], problem: Problem, accepted: Accepted) -> float:
    """Energy of what some of the chosen explain, each for itself, over that of what they explain together: 1 where they are independent."""
    each = [
        problem.library[c][0].spread(part, len(accepted.fit))
        for c, part in zip(chosen, problem.parts(chosen, accepted))
        if c in own
    ]
    return float(sum(np.sum(one**2) for one in each) / np.sum(np.sum(each, axis=0) ** 2))


def _meet(one: Columns, other: Columns) -> bool:
    return one.where.start < other.where.stop and other.where.start < one.where.stop


def simplified(
    chosen: list[Candidate],
    problem: Problem,
    sides: tuple[Side, Side],
    equals: dict[EffectKey, list[Look]],
    banned: Set[EffectKey],
) -> tuple[list[Candidate], tuple[Side, Side]]:
    """The chosen, with fewer or simpler effects in the place of others where nothing that matters is lost.

    Two parts of an effect at one joint are that effect. One that contains a simpler one is that simpler one, if that is enough: while other
    causes were missing or known to first order only, the one with more coefficients may have fitted their rest.
    """
    for put, gone in _simpler(chosen):
        if put not in problem.library or put.key in banned or put in chosen or not set(gone) <= set(chosen):
            continue
        trial = [put if one is gone[0] else one for one in chosen if one not in gone[1:]]
        anew = corrected(trial, problem, problem.sides)
        before, after = problem.accepted(chosen, sides), problem.accepted(trial, anew)
        lost = np.sum(after.held_out**2) - np.sum(before.held_out**2)
        if lost < SHARE_OF_NOISE * sides[1].rows:
            equals[put.key] = [one for one in equals[gone[0].key] if one.candidate.key != gone[0].key]
            chosen, sides = trial, anew
    return chosen, sides


def _simpler(chosen: Sequence[Candidate]) -> Iterator[tuple[Candidate, tuple[Candidate, ...]]]:
    """An effect, and those of the chosen in whose place it may do: the whole for several of its parts, a part for the whole."""
    for whole in CATALOGUE.values():
        for joint in sorted({c.joint for c in chosen if c.joint}):
            own = tuple(c for c in chosen if c.joint == joint and c.effect in whole.special_cases)
            if len(own) > 1:
                yield Candidate(whole.name, joint), own
    for c in chosen:
        for part in (*c.definition.special_cases, *c.definition.near_cases):
            yield Candidate(part, c.joint), (c,)


def corrected(chosen: Sequence[Candidate], problem: Problem, sides: tuple[Side, Side]) -> tuple[Side, Side]:
    """Both sides with y = (residual of the exact extended model) + (first-order columns times their coefficients).

    Where the exact model leaves more than its first order did (parameters out of its range), nothing is corrected.
    """
    for _ in range(CORRECTIONS):
        accepted = problem.accepted(chosen, sides)
        parts = problem.parts(chosen, accepted)
        terms = _terms(chosen, parts)
        exact = [side_with(side, terms) for side in problem.sides]
        once = [
            np.ones_like(part) if c.unit_amplitude else part for c, part in zip(chosen, parts)
        ]  # as the exact model has them
        linear = [_spread(chosen, once, problem, which) for which in (0, 1)]
        first, second = (
            replace(side, y=y, corrected=side.by_joint((y - side.y) ** 2))
            for side, y in zip(problem.sides, (exact[0] + linear[0], exact[1] + linear[1]))
        )
        trial = first, second
        if np.sum(problem.accepted(chosen, trial).fit ** 2) > WORSE * np.sum(accepted.fit**2):
            return sides
        sides = trial
    return sides


def terms_of(problem: Problem, found: Found) -> list[EffectTerm]:
    """What was found, as effects of a model."""
    return _terms(found.chosen, problem.parts(found.chosen, problem.accepted(found.chosen, found.sides)))


def _terms(chosen: Sequence[Candidate], parts: Sequence[Array]) -> list[EffectTerm]:
    return [EffectTerm(c.effect, c.joint, c.parameters(part.tolist())) for c, part in zip(chosen, parts)]


def polished(chosen: list[Candidate], problem: Problem, sides: tuple[Side, Side]) -> list[Candidate]:
    """The chosen with their continuous shape parameters where the exact model fits best: one step of Gauss and Newton, kept if it is one down."""
    searched = [(k, name) for k, c in enumerate(chosen) for name in c.searched()]
    if not searched:
        return chosen
    fit, accepted = problem.sides[0], problem.accepted(chosen, sides)
    parts = problem.parts(chosen, accepted)
    here = side_with(fit, _terms(chosen, parts))
    slopes, steps = [], []
    for k, name in searched:
        steps.append(0.02 * dict(chosen[k].shape)[name])
        moved = [c.at(name, dict(c.shape)[name] + steps[-1]) if n == k else c for n, c in enumerate(chosen)]
        slopes.append((side_with(fit, _terms(moved, parts)) - here) / steps[-1])
    slope = np.stack(slopes, axis=1)
    slope -= accepted.basis @ (accepted.basis.T @ slope)
    change = -np.linalg.lstsq(slope, here - accepted.basis @ (accepted.basis.T @ here), rcond=1e-3)[0]
    better = list(chosen)
    for (k, name), by in zip(searched, change):
        value = dict(better[k].shape)[name]
        better[k] = better[k].at(name, float(np.clip(value + by, value / 2, 2 * value)))
    for c in better:
        if c not in problem.library:
            problem.library[c] = (
                columns_of(c, problem.sides[0], problem.arm),
                columns_of(c, problem.sides[1], problem.arm),
            )
    left = [
        np.sum(problem.accepted(these, corrected(these, problem, problem.sides)).fit ** 2) for these in (chosen, better)
    ]
    return better if left[1] < left[0] else chosen


def _spread(chosen: Sequence[Candidate], parts: Sequence[Array], problem: Problem, which: int) -> Array:
    total = np.zeros(len(problem.sides[which].y))
    for candidate, part in zip(chosen, parts):
        columns = problem.library[candidate][which]
        total[columns.where] += columns.x @ part
    return total


def weeded(chosen: list[Candidate], problem: Problem, sides: tuple[Side, Side]) -> list[Candidate]:
    """Backward deletion: causes whose held-out gain beside all others no longer matters are dropped, the least first."""
    while len(chosen) > 1:
        gains = [
            look(c, problem.library[c], problem.accepted([o for o in chosen if o is not c], sides), sides[1])
            for c in chosen
        ]
        shadow = shadows(sides[1], problem.accepted(chosen, sides))
        least = min(gains, key=lambda one: one.held_out_gain)
        if matters(least.by_joint, len(least.coefficients), shadow, sides[1]):
            break
        chosen = [c for c in chosen if c is not least.candidate]
    return chosen
