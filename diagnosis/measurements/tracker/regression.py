"""Which of the tracker's candidates are there: forward on held-out points, with a refit of all after each, then backward.

Screening is linear: about the present fit, what a candidate's columns and all that is already free explain of the fitted points, judged by
what it does to the held-out ones. A candidate enters if that is larger than ``SHARE`` of what the points cannot tell. Refits are not linear, so that
a strong effect leaves no shadow. When nothing enters any more, each has to be significant beside all the others, over one-second blocks
(``identification.selection.significance``): before, two effects of one size hide each other's significance.
Equals of a named one are refitted in its place: whatever then does as well on the held-out points is one group with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model.effects.tracking import LINK_GEOMETRY
from diagnosis.measurements.tracker.columns import GEOMETRY, Candidate, State, points_of, possible, turns
from diagnosis.measurements.tracker.points import Side
from identification.kinematics.estimation.map_estimation import REJECT, residuals
from identification.kinematics.models.chain import position_jacobian
from identification.selection.significance import p_value

Refit = Callable[[Sequence[Candidate], State | None], State]

SIGNIFICANT = 0.05
SHARE = 0.1
"""Of the energy of what the points cannot tell (noise, encoder zeros), that a cause must be worth."""
ALIKE = 0.02
"""Of the same energy, within which two explanations are equal."""
TRIED = 4
"""Candidates that are refitted in a round, if those before them turn out to be impossible."""
WORTH_A_REFIT = 0.7
"""Of a cause's linear gain, that makes another its possible equal."""


@dataclass(frozen=True)
class Look:
    """A candidate beside the chosen ones: held-out gain (m^2) by block and in all."""

    candidate: Candidate
    gain: float
    p: float
    blocks: Array = field(repr=False)


@dataclass(frozen=True)
class Named:
    """A chosen candidate: everything that does as well in its place (itself first), and its gain over all the others."""

    candidate: Candidate
    equals: tuple[Candidate, ...]
    look: Look
    before: Array = field(repr=False)  # (N, 3) m: held-out residual without it, all others refitted


def left(state: State, side: Side) -> Array:
    """(N, 3) m: measured less fitted points of a side."""
    return residuals(state.parameters, state.values, state.estimate.extension, state.points(side))


def good(residual: Array) -> NDArray[np.bool_]:
    """(N,) rows without those that are wrong by far."""
    length = np.linalg.norm(residual, axis=1)
    return np.asarray(length <= _largest(length))


def select(
    every: Sequence[Candidate],
    fit: Side,
    held_out: Side,
    level: float,
    refit: Refit,
    most: int,
    tell: Callable[[str], None],
) -> State:
    """The candidates that are there, fitted together. level m: deviation of a coordinate that the points cannot tell from nothing."""
    enough = SHARE * 3 * len(held_out) * level**2
    state = refit((), None)
    for number in range(1, most + 1):
        tell(f"looking for cause {number} in the tracker's points")
        looks = _looks([c for c in every if _new(c, state.chosen)], state, fit, held_out)
        able = [one for one in looks if one.gain > enough]
        after = next(
            filter(None, (_entered(one, state, held_out, enough, refit) for one in _in_order(able, held_out, level))),
            None,
        )
        if after is None:
            break
        weeded = _weeded(after, held_out, enough, refit)
        if set(weeded.chosen) == set(state.chosen):
            break
        state = weeded
    return _weeded(state, held_out, enough, refit, tests=len(every))


def _in_order(able: Sequence[Look], held_out: Side, level: float) -> list[Candidate]:
    """The largest gain first; of those that are as good as the best, the one with the fewest coefficients."""
    largest = max((one.gain for one in able), default=0.0)
    alike = largest - ALIKE * 3 * len(held_out) * level**2
    return [
        one.candidate
        for one in sorted(able, key=lambda one: (0, one.candidate.size) if one.gain > alike else (1, -one.gain))
    ][:TRIED]


def _entered(candidate: Candidate, state: State, held_out: Side, enough: float, refit: Refit) -> State | None:
    """All refitted with the candidate beside the chosen ones; None where it then gains too little, or has a sign that cannot be."""
    entering = _merged(candidate, state.chosen)
    after = refit([c for c in state.chosen if not _within(c, entering)] + [entering], state)
    gain = energy(left(state, held_out)) - energy(left(after, held_out))
    return after if gain > enough and possible(entering, after.coefficients(entering)[0]) else None


def named(
    every: Sequence[Candidate], state: State, fit: Side, held_out: Side, level: float, refit: Refit
) -> list[Named]:
    """The chosen candidates with their equals and gains, the largest gain first."""
    tolerance = ALIKE * 3 * len(held_out) * level**2
    reached = energy(left(state, held_out))
    found = []
    for candidate in state.chosen:
        others = [c for c in state.chosen if c is not candidate]
        without = refit(others, state)
        looks = _looks([c for c in every if _new(c, others)], without, fit, held_out)
        own = next(one for one in _looks([candidate], without, fit, held_out))
        equals = [candidate]
        alike = [one.candidate for one in looks if one.gain > WORTH_A_REFIT * own.gain]
        for other in alike + _of_the_same_errors(alike, candidate):
            if other.key == candidate.key:
                continue
            swapped = refit([*others, other], without)
            fine = possible(other, swapped.coefficients(other)[0])
            if fine and energy(left(swapped, held_out)) < reached + tolerance:
                equals.append(other)
        found.append(Named(candidate, _distinct(equals), own, left(without, held_out)))
    return sorted(found, key=lambda one: -one.look.gain)


def _weeded(state: State, held_out: Side, enough: float, refit: Refit, tests: int | None = None) -> State:
    """Without those whose loss the others make good, the least needed first.

    tests: of so many candidates; those are left out as well whose gain over all the others is not significant (Benjamini and Hochberg).
    """
    while state.chosen and (tests is not None or len(state.chosen) > 1):
        reached = squares(left(state, held_out))
        losses = []
        for candidate in state.chosen:
            without = refit([c for c in state.chosen if c is not candidate], state)
            by_block = _by_block(squares(left(without, held_out)) - reached, held_out)
            chance = 0.0 if tests is None else p_value(by_block) * tests / len(state.chosen)
            losses.append((chance > SIGNIFICANT or by_block.sum() < enough, chance, -by_block.sum(), without))
        unneeded, *_, without = max(losses, key=lambda one: one[:3])
        if not unneeded:
            break
        state = without
    return state


def _looks(every: Sequence[Candidate], state: State, fit: Side, held_out: Side) -> list[Look]:
    sides = [linear(state, side) for side in (fit, held_out)]
    looks = []
    for candidate in every:
        columns = [columns_of(candidate, state, side, one) for side, one in zip((fit, held_out), sides)]
        keep, keep_held = sides[0].good, sides[1].good
        a = np.concatenate((sides[0].free[keep], columns[0][keep]), axis=2)
        flat = a.reshape(-1, a.shape[2]) / state.estimate.noise
        step = np.linalg.solve(
            flat.T @ flat + np.eye(flat.shape[1]), flat.T @ (sides[0].residual[keep].ravel() / state.estimate.noise)
        )
        new = sides[1].residual - np.concatenate((sides[1].free, columns[1]), axis=2) @ step
        gains = np.where(keep_held, np.sum(sides[1].residual ** 2 - new**2, axis=1), 0.0)
        by_block = _by_block(gains, held_out)
        looks.append(Look(candidate, float(by_block.sum()), p_value(by_block), by_block))
    return looks


@dataclass(frozen=True)
class Linear:
    """A side about a fit: residual (N, 3), columns of all that is free (N, 3, k) per prior deviation, every step's (N, 3, steps)."""

    residual: Array
    free: Array
    every: Array
    good: NDArray[np.bool_]


def linear(state: State, side: Side) -> Linear:
    points, extension = points_of(state.chosen, side), state.estimate.extension
    chain = state.parameters.chain.at(state.values)
    at, every = position_jacobian(chain, points.bent(extension))
    free = state.parameters.free
    columns = every[:, :, free] * state.parameters.scale[free]
    if points.deflections is not None:
        bend = every[:, :, chain.joint_steps()] @ points.deflections
        scales = np.concatenate([c.scales for c in state.chosen if not c.names])
        columns = np.concatenate((columns, bend * scales), axis=2)
    residual = side.xyz - at
    return Linear(residual, columns, every, good(residual))


def columns_of(candidate: Candidate, state: State, side: Side, about: Linear) -> Array:
    chain = state.parameters.chain
    if candidate.names:
        where = [chain.names.index(name) for name in candidate.values]
        return about.every[:, :, where] * candidate.scales
    return np.asarray(about.every[:, :, chain.joint_steps()] @ turns(candidate, side), float) * candidate.scales


def squares(residual: Array) -> Array:
    """(N,) squared distances, those of wrong points as far as they could be right."""
    length = np.linalg.norm(residual, axis=1)
    return np.asarray(np.minimum(length, _largest(length)) ** 2)


def energy(residual: Array) -> float:
    """Sum of ``squares``."""
    return float(np.sum(squares(residual)))


def _by_block(values: Array, side: Side) -> Array:
    """Sums of values (N,) over the side's one-second blocks."""
    return np.bincount(np.unique(side.block, return_inverse=True)[1], weights=values).astype(float)


def _largest(length: Array) -> float:
    return REJECT * max(float(np.median(length)) / 1.5382, 1e-9)


def _new(candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
    """Not chosen yet, nor part of what is."""
    return not any(_within(candidate, c) for c in chosen)


def _merged(entering: Candidate, chosen: Sequence[Candidate]) -> Candidate:
    """With the geometric errors of the same link that are chosen already."""
    names = {name for c in chosen if c.key == entering.key for name in c.names}
    return replace(entering, names=tuple(name for name in GEOMETRY if name in names | set(entering.names)))


def _within(one: Candidate, other: Candidate) -> bool:
    """Whether ``other`` can do everything that ``one`` can: the same, or all of its values and more."""
    if one.names and other.names:
        return set(one.values) <= set(other.values)
    return one.key == other.key


def _of_the_same_errors(alike: Sequence[Candidate], candidate: Candidate) -> list[Candidate]:
    """Other links with just those geometric errors that the candidate has: with all five they would follow the encoders' zeros."""
    if candidate.effect != LINK_GEOMETRY.name:
        return []
    return [replace(c, names=candidate.names) for c in alike if c.effect == LINK_GEOMETRY.name]


def _distinct(equals: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The first of each effect and joint."""
    return tuple({c.key: c for c in reversed(equals)}[key] for key in dict.fromkeys(c.key for c in equals))
