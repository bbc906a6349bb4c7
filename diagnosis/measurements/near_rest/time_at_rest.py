"""How the break-away level of a joint rises with the time at rest.

The longer two surfaces rest on each other, the more force it takes to part them: the level grows with the logarithm of
the time at rest (Rabinowicz, Proc. Phys. Soc. 71, 1958; Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7),
1994). Where a hump of friction is known, its height is fitted to every break-away by itself, and these heights to

    height = level + rise log10(time at rest).

A joint stands where ``NearRest.standstill`` says so; it rests there from the first to the last instant at which it is
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
from diagnosis.measurements.near_rest.passages import STANDS, NearRest, near_rest, observations, speed_noise
from diagnosis.residual.filters import kept_rows, rate_of
from diagnosis.residual.run import Run

STILL = STANDS / 10.0
"""rad/s (m/s)."""
BREAKS_AWAY = 1.0
"""s after a rest in which rows show its break-away."""
SHOWS = 0.5
"""Of the level: std of a height by the noise of its rows from which a break-away shows none."""
FEWEST = 6
"""Break-aways that a rise is estimated from."""
OVER = 1.5
"""Times the velocity of a hump at which it is over (exp(-2.25))."""
FORGETS = 3.0
"""Ways to the end of the hump over which sliding renews contacts: over fewer, a break-away itself would renew them."""
VARIES = 4.0
"""Times the shortest rest that the longest must last: over less than 0.6 decades, level and rise are not distinct."""


@dataclass(frozen=True)
class BreakAways:
    """n break-aways: s at rest before each, height N m (N) of the hump in each, and its std by noise alone.

    slid: rad (m) until the hump is over.
    """

    rested: Array
    height: Array
    std: Array
    slid: Array


def with_rise_at_rest(causes: Sequence[Cause], runs: Sequence[Run], terms: Sequence[EffectTerm]) -> list[Cause]:
    """The causes; those that are humps of friction get the rise of their level with the time at rest.

    terms: effects of all causes that the arm of the ``runs`` does not have.
    """
    humps = [cause.key for cause in causes if cause.joint is not None and _is_hump(CATALOGUE[cause.effect])]
    recordings = observations(runs, terms) if humps else []
    return [
        replace(cause, rise_at_rest=rise_at_rest(cause, near_rest(recordings, cause.joint)))
        if cause.joint is not None and cause.key in humps
        else cause
        for cause in causes
    ]


def _is_hump(effect: Effect) -> bool:
    """Whether an effect is a hump of friction near rest, whose level may rise."""
    return bool(effect.rises_by)


def rise_at_rest(cause: Cause, every: Sequence[NearRest]) -> RiseAtRest:
    """The rise of a hump's level, from the residual that it leaves near rest in ``every`` recording."""
    values, unit = {p.name: p.value for p in cause.parameters}, cause.parameters[0].unit
    effect = CATALOGUE[cause.effect]
    measured = break_aways(every, effect, values) if every else BreakAways(*np.zeros((4, 0)))
    shortest, longest = (float(of(measured.rested)) if len(measured.rested) else 0.0 for of in (np.min, np.max))
    result = RiseAtRest(unit=unit, rests=len(measured.rested), shortest=shortest, longest=longest)
    if result.rests < FEWEST or longest < VARIES * shortest:
        return result
    x = np.column_stack([np.ones_like(measured.rested), np.log10(measured.rested)])
    # break-aways scatter by more than the noise of their rows
    weight = 1.0 / np.maximum(measured.std, np.median(measured.std))
    weighted = x * weight[:, None]
    solved = np.linalg.lstsq(weighted, measured.height * weight, rcond=None)[0]
    residual = (measured.height - x @ solved) * weight
    covariance = np.linalg.inv(weighted.T @ weighted) * float(residual @ residual) / (len(x) - 2)
    rise, std = float(solved[1]), float(np.sqrt(covariance[1, 1]))
    result = replace(result, value=rise, std=float(np.hypot(std, effect.model_error * rise)))
    if not result.determined:
        return result
    level = values[effect.linear[0].name]
    reference = float(np.clip(10.0 ** ((level - float(solved[0])) / rise), shortest, longest))
    return replace(result, reference=reference, slip=FORGETS * float(np.median(measured.slid)))


@dataclass(frozen=True)
class Rest:
    """A rest that begins within a recording.

    of: number of the recording; rested: s; shows: which of its r rows show the break-away; slid: rad (m) that the joint
    then slides until its hump is over.
    """

    of: int
    rested: float
    shows: NDArray[np.bool_]
    slid: float


def break_aways(every: Sequence[NearRest], effect: Effect, values: dict[str, float]) -> BreakAways:
    """Heights of a hump, the ``effect`` with parameters ``values``, each from the rows of one break-away."""
    ends = OVER * max(values[p.name] for p in effect.nonlinear)
    rests = [rest for k, one in enumerate(every) for rest in _rests(k, one, ends)]
    best = min((_heights(every, rests, (effect, values), width) for width in WIDTHS), key=lambda of: of[0])
    heights, std = best[1:]
    shows = std < SHOWS * values[effect.linear[0].name]
    rested, slid = (np.array([getattr(rest, name) for rest in rests])[shows] for name in ("rested", "slid"))
    return BreakAways(rested, heights[shows], std[shows], slid)


def _heights(
    every: Sequence[NearRest],
    rests: Sequence[Rest],
    law: tuple[Effect, dict[str, float]],
    width: float,
) -> tuple[float, Array, Array]:
    """Squared residual with the hump at a smoothing velocity; the height of every break-away, and its std."""
    (effect, values), name = law, law[0].linear[0].name
    level, unit = values[name], {**values, name: 1.0}
    shapes, parts, energy = [], [], 0.0
    for one in every:
        w = width * one.run.arm.joints[one.joint - 1].sign_velocity
        shape = one.of(one.of_law(effect, unit, w))
        remaining = one.residual + level * one.of(one.of_law(effect, unit)) - one.of(one.smoothed(np.array([w]))[:, 0])
        shapes.append(shape)
        parts.append(remaining)
        energy += float(np.sum((remaining - level * shape) ** 2))
    shown = [(shapes[rest.of][rest.shows], parts[rest.of][rest.shows]) for rest in rests]
    size = np.array([max(float(shape @ shape), 1e-12) for shape, _ in shown])
    heights = np.array([float(shape @ part) for shape, part in shown]) / size
    return energy, heights, 1.0 / np.sqrt(size)


def _rests(number: int, one: NearRest, ends: float) -> Iterator[Rest]:
    """Every rest that begins within a recording of this ``number``; ``ends`` rad/s (m/s): where a hump is over."""
    rate = rate_of(one.run.raw[0])
    place = np.arange(len(one.v))[kept_rows(rate)][one.rows]
    label, count = ndimage.label(one.standstill)
    stands = [part for (part,) in ndimage.find_objects(label)]
    still = np.abs(one.v) < max(STILL, 3.0 * speed_noise(one.run, one.joint))
    for k in range(count):
        part = stands[k]
        until = stands[k + 1].start if k + 1 < count else len(one.v)
        after_rest = (place >= part.stop) & (place < min(until, part.stop + BREAKS_AWAY * rate))
        rests = np.flatnonzero(still[part])
        if part.start > 0 and after_rest.any() and len(rests):
            speed = np.abs(one.v[part.stop : until])
            over = int(np.argmax(speed > ends)) or len(speed)
            yield Rest(number, (rests[-1] + 1 - rests[0]) / rate, after_rest, float(np.sum(speed[:over])) / rate)
