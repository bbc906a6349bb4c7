"""Laws of friction near rest as trials, and what each leaves of a recording that is predicted from all others."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model.effects import CATALOGUE, Effect, friction_near_rest
from diagnosis.measurements.currents.columns import columns
from diagnosis.measurements.near_rest.passages import NearRest
from diagnosis.selection.candidate import Candidate

WIDTHS = np.array([0.1, 0.2, 0.3, 0.45, 0.65, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5])
"""Smoothing velocities that are tried, as multiples of the model's own."""


@dataclass(frozen=True)
class Law:
    """T trials of one law, in every recording: a change of the residual each, and what its coefficient multiplies.

    effect        None: another smoothing velocity alone
    values        of the T trials; offset, column (T, r) over std, of each recording
    """

    effect: str | None
    values: Sequence[dict[str, float]]
    offset: Sequence[Array]
    column: Sequence[Array]


@dataclass(frozen=True)
class Judged:
    """A law predicted in every recording from all others: what it leaves (r,) of each, over std."""

    law: Law
    left: Sequence[Array]

    @property
    def energy(self) -> float:
        """Squared residual of all recordings."""
        return float(sum(part @ part for part in self.left))


def judged(every: Sequence[NearRest], law: Law) -> Judged:
    """What a law leaves of every recording by the trial and the coefficient that fit all others best."""
    products, left = _products(every, law), []
    for k, one in enumerate(every):
        trial, c = _fitted(*(part.sum(axis=0) - part[k] for part in products))
        left.append(one.residual - law.offset[k][trial] - c * law.column[k][trial])
    return Judged(law, left)


def _products(every: Sequence[NearRest], law: Law) -> tuple[Array, Array, Array]:
    """(recordings, T) of residual and column, each: squares of the first, both, squares of the second."""
    y = [one.residual - offset for one, offset in zip(every, law.offset)]
    yy, xy, xx = (
        np.array([np.sum(a * b, axis=1) for a, b in zip(left, right)])
        for left, right in ((y, y), (law.column, y), (law.column, law.column))
    )
    return yy, xy, xx


def _fitted(yy: Array, xy: Array, xx: Array) -> tuple[int, float]:
    """Trial of (T,) that leaves least, and its coefficient, which is not negative."""
    c = np.maximum(xy, 0.0) / np.where(xx > 0.0, xx, 1.0)
    trial = int(np.argmin(yy - 2.0 * c * xy + c**2 * xx))
    return trial, float(c[trial])


def smoothing(every: Sequence[NearRest]) -> Law:
    widths = WIDTHS * every[0].run.arm.joints[every[0].joint - 1].sign_velocity
    offset = [one.of(one.smoothed(widths)).T for one in every]
    return Law(None, [{"width": float(w)} for w in widths], offset, [np.zeros_like(part) for part in offset])


def law_of(every: Sequence[NearRest], effect: Effect) -> Law:
    """Trials over the searched parameters of an effect; where its friction turns with it, over smoothings as well."""
    grid = [
        dict(zip((p.name for p in effect.parameters if p.search), values))
        for values in itertools.product(*(p.search for p in effect.parameters if p.search))
    ]
    if effect.rate is not None:
        # friction with a state turns by itself: no smoothing is left
        offset = [one.of(np.stack([one.of_law(effect, values) for values in grid], axis=1)).T for one in every]
        return Law(effect.name, grid, offset, [np.zeros_like(part) for part in offset])
    smooth, unit = smoothing(every), {p.name: 1.0 for p in effect.linear}
    widths = [value["width"] for value in smooth.values]
    column = [
        one.of(np.stack([one.of_law(effect, {**unit, **values}, w) for w in widths for values in grid], axis=1)).T
        for one in every
    ]
    offset = [np.repeat(part, len(grid), axis=0) for part in smooth.offset]
    return Law(effect.name, [{**values, "width": w} for w in widths for values in grid], offset, column)


def confused(every: Sequence[NearRest], joint: int, library: Sequence[Candidate]) -> Law:
    """Candidates of other effects at the joint that may be confused with friction near rest."""
    names = {name for effect in friction_near_rest() for name in effect.confused_with}
    own = {effect.name for effect in friction_near_rest()}
    chosen = [c for c in library if c.joint == joint and c.effect in names - own]
    column = [
        np.concatenate([np.atleast_2d(columns(c, one.run)[one.rows, joint - 1].T) for c in chosen]) / one.std
        if chosen
        else np.zeros((1, len(one.residual)))
        for one in every
    ]
    return Law(None, [dict(c.shape) for c in chosen], [np.zeros_like(part) for part in column], column)


def fitted_to_all(every: Sequence[NearRest], law: Law) -> dict[str, float]:
    """Parameters of the trial that fits all recordings best; coefficients of 0 where another smoothing does as well."""
    assert law.effect is not None
    trial, c = _fitted(*(part.sum(axis=0) for part in _products(every, law)))
    return {**law.values[trial], **{p.name: c for p in CATALOGUE[law.effect].linear}}


def torque_of(one: NearRest, effect: Effect, values: dict[str, float]) -> Array:
    """(k,) N m: the law with its parameters, and the smoothing velocity that goes with it."""
    own = {name: value for name, value in values.items() if name != "width"}
    if "width" not in values:
        return one.of_law(effect, own)
    return one.smoothed(np.array([values["width"]]))[:, 0] + one.of_law(effect, own, values["width"])
