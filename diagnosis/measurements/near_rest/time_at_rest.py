"""How the break-away level of a joint rises with the time at rest.

The longer two surfaces rest on each other, the more force it takes to part them: the level grows with the logarithm of
the time at rest (Rabinowicz, Proc. Phys. Soc. 71, 1958; Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7),
1994). Where a hump of friction is known, its height is fitted to every break-away by itself, and these heights to

    height = level + rise log10(time at rest).

A joint stands where ``passages.standing`` says so; it rests there from the first to the last instant at which it is
slower than ``STILL``, or than its encoder shows. How long it had rested when a recording began is not known.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from arm_io.types import Array
from arm_model import EffectTerm
from arm_model.effects import CATALOGUE, Effect
from diagnosis.cause import Cause, RiseAtRest
from diagnosis.measurements.near_rest.laws import WIDTHS
from diagnosis.measurements.near_rest.passages import STANDS, NearRest, near_rest, speed_noise, standing
from diagnosis.residual.expected_current import rate_of
from diagnosis.residual.run import Run, kept

STILL = STANDS / 10.0
"""rad/s (m/s)."""
BREAKS_AWAY = 1.0
"""s after a rest in which rows show its break-away."""
SHOWS = 0.5
"""Of the level: std of a height by the noise of its rows from which a break-away shows none."""
FEWEST = 6
"""Break-aways that a rise is estimated from."""
VARIES = 4.0
"""Times the shortest rest that the longest must last."""


@dataclass(frozen=True)
class BreakAways:
    """n break-aways: s at rest before each, height N m (N) of the hump in each, and its std by noise alone."""

    rested: Array
    height: Array
    std: Array


def with_rise_at_rest(causes: Sequence[Cause], runs: Sequence[Run], terms: Sequence[EffectTerm]) -> list[Cause]:
    """The causes, humps of friction with the rise of their level with the time at rest.

    terms: effects of all causes that the arm of the ``runs`` does not have.
    """
    return [
        replace(cause, rise_at_rest=rise_at_rest(cause, near_rest(runs, cause.joint, terms)))
        if cause.joint is not None and _is_hump(CATALOGUE[cause.effect])
        else cause
        for cause in causes
    ]


def _is_hump(effect: Effect) -> bool:
    """Whether it is friction near rest that has a level."""
    return effect.near_rest and bool(effect.linear)


def rise_at_rest(cause: Cause, every: Sequence[NearRest]) -> RiseAtRest:
    """The rise of a hump's level, from the residual that it leaves near rest in ``every`` recording."""
    values, unit = {p.name: p.value for p in cause.parameters}, cause.parameters[0].unit
    effect = CATALOGUE[cause.effect]
    seen = break_aways(every, effect, values) if every else BreakAways(np.zeros(0), np.zeros(0), np.zeros(0))
    shortest, longest = (float(of(seen.rested)) if len(seen.rested) else 0.0 for of in (np.min, np.max))
    found = RiseAtRest(unit=unit, rests=len(seen.rested), shortest=shortest, longest=longest)
    if found.rests < FEWEST or longest < VARIES * shortest:
        return found
    x = np.column_stack([np.ones_like(seen.rested), np.log10(seen.rested)])
    # one break-away scatters by more than the noise of its rows
    weight = 1.0 / np.maximum(seen.std, np.median(seen.std))
    solved = np.linalg.lstsq(x * weight[:, None], seen.height * weight, rcond=None)[0]
    left = (seen.height - x @ solved) * weight
    covariance = np.linalg.inv((x * weight[:, None]).T @ (x * weight[:, None])) * float(left @ left) / (len(x) - 2)
    rise, std = float(solved[1]), float(np.sqrt(covariance[1, 1]))
    return replace(found, value=rise, std=float(np.hypot(std, effect.model_error * rise)))


def break_aways(every: Sequence[NearRest], effect: Effect, values: dict[str, float]) -> BreakAways:
    """Heights of a hump, the ``effect`` with parameters ``values``, each from the rows of one break-away."""
    rows = [(k, rested, here) for k, one in enumerate(every) for rested, here in _after_rests(one)]
    best = min((_heights(every, rows, (effect, values), width) for width in WIDTHS), key=lambda of: of[0])
    heights, std = best[1:]
    shows = std < SHOWS * values[effect.linear[0].name]
    return BreakAways(np.array([rested for _, rested, _ in rows])[shows], heights[shows], std[shows])


def _heights(
    every: Sequence[NearRest],
    rows: Sequence[tuple[int, float, NDArray[np.bool_]]],
    law: tuple[Effect, dict[str, float]],
    width: float,
) -> tuple[float, Array, Array]:
    """Squared residual with the hump at a smoothing velocity; the height of every break-away, and its std."""
    (effect, values), name = law, law[0].linear[0].name
    level, unit = values[name], {**values, name: 1.0}
    shapes, parts, left = [], [], 0.0
    for one in every:
        w = width * one.run.arm.joints[one.joint - 1].sign_velocity
        shape = one.of(one.of_law(effect, unit, w))
        rest = one.residual + level * one.of(one.of_law(effect, unit)) - one.of(one.smoothed(np.array([w]))[:, 0])
        shapes.append(shape)
        parts.append(rest)
        left += float(np.sum((rest - level * shape) ** 2))
    size = np.array([max(float(shapes[k][here] @ shapes[k][here]), 1e-12) for k, _, here in rows])
    heights = np.array([float(shapes[k][here] @ parts[k][here]) for k, _, here in rows]) / size
    return left, heights, 1.0 / np.sqrt(size)


def _after_rests(one: NearRest) -> Iterator[tuple[float, NDArray[np.bool_]]]:
    """s of every rest that begins within a recording, and which of the r rows show the break-away from it."""
    rate = rate_of(one.run.raw[0])
    place = np.arange(len(one.v))[kept(rate)][one.rows]
    label, count = ndimage.label(standing(one.v, rate))
    stands = [part for (part,) in ndimage.find_objects(label)]
    still = np.abs(one.v) < max(STILL, 3.0 * speed_noise(one.run, one.joint))
    for number in range(count):
        part = stands[number]
        until = stands[number + 1].start if number + 1 < count else len(one.v)
        here = (place >= part.stop) & (place < min(until, part.stop + BREAKS_AWAY * rate))
        rests = np.flatnonzero(still[part])
        if part.start > 0 and here.any() and len(rests):
            yield (rests[-1] + 1 - rests[0]) / rate, here
