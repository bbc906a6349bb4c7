"""Laws of friction near rest as trials, and what each leaves of a recording that is predicted from all others."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model.effects import CATALOGUE, Effect, Scale, friction_near_rest
from diagnosis.measurements.currents.columns import own_columns
from diagnosis.measurements.near_rest.passages import NearRest, position_noise
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate

WIDTHS = np.array([0.03, 0.1, 0.2, 0.3, 0.45, 0.65, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5])
"""Smoothing velocities that are tried, as multiples of the model's own."""
STIFFNESSES = 9
"""Number of stiffnesses of bristles that are tried."""
REFINED = 2
"""Times that values are tried about the best so far."""
BETWEEN = 5
"""Number of values of each parameter that are tried then."""
SOFTEST = 0.2
"""Share of the travel over which the softest bristles that are tried build up their friction."""
RESOLVED = 2.0
"""Standard deviations of a recorded angle over which friction must build up to differ from friction without a
state."""


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
class Residuals:
    """Residuals (r,) of every recording after a law, over their std."""

    law: Law
    residuals: Sequence[Array]

    @property
    def energy(self) -> float:
        """Squared residual of all recordings."""
        return float(sum(part @ part for part in self.residuals))


def predicted(every: Sequence[NearRest], law: Law) -> Residuals:
    """Residual of every recording with the trial and coefficient that fit all other recordings best."""
    products = _products(every, law)
    by = [_fitted(*(part.sum(axis=0) - part[k] for part in products)) for k in range(len(every))]
    return _residuals(every, law, by)


def in_sample(every: Sequence[NearRest], law: Law) -> Residuals:
    """Residual of every recording with the trial and coefficient that fit all recordings best.

    Of what another law must beat: the few rows of one recording may predict a long one as badly as they like.
    """
    by = _fitted(*(part.sum(axis=0) for part in _products(every, law)))
    return _residuals(every, law, [by] * len(every))


def _residuals(every: Sequence[NearRest], law: Law, by: Sequence[tuple[int, float]]) -> Residuals:
    """by: of each recording, the trial and its coefficient."""
    parts = zip(every, law.offset, law.column, by, strict=True)
    return Residuals(law, [one.residual - offset[k] - c * column[k] for one, offset, column, (k, c) in parts])


def _products(every: Sequence[NearRest], law: Law) -> tuple[Array, Array, Array]:
    """(recordings, T) of residual and column, each: squares of the first, both, squares of the second."""
    y = [one.residual - offset for one, offset in zip(every, law.offset)]
    yy, xy, xx = (
        np.array([np.sum(a * b, axis=1) for a, b in zip(first, second)])
        for first, second in ((y, y), (law.column, y), (law.column, law.column))
    )
    return yy, xy, xx


def _fitted(yy: Array, xy: Array, xx: Array) -> tuple[int, float]:
    """The trial, of (T,), with the smallest residual, and its coefficient, which is not negative."""
    c = np.maximum(xy, 0.0) / np.where(xx > 0.0, xx, 1.0)
    trial = int(np.argmin(yy - 2.0 * c * xy + c**2 * xx))
    return trial, float(c[trial])


def smoothing(every: Sequence[NearRest]) -> Law:
    """Trials of other smoothing velocities (``WIDTHS``) of the model's own friction, without another law."""
    widths = WIDTHS * every[0].run.arm.joints[every[0].joint - 1].sign_velocity
    offset = [one.of(one.smoothed(widths)).T for one in every]
    return Law(None, [{"width": float(w)} for w in widths], offset, [np.zeros_like(part) for part in offset])


def smoothing_velocity(every: Sequence[NearRest]) -> float:
    """rad/s (m/s): the smoothing velocity that fits all recordings best, without another law."""
    law = smoothing(every)
    trial, _ = _fitted(*(part.sum(axis=0) for part in _products(every, law)))
    return law.values[trial]["width"]


def law_of(every: Sequence[NearRest], effect: Effect) -> Law:
    """Trials over the searched parameters of an effect: first over their whole range, then around the best trial.

    If its friction changes sign with that of the model, smoothing velocities are tried as well.
    """
    law = _trials(every, effect, _grid(every, effect))
    for _ in range(REFINED):
        law = _both(law, _trials(every, effect, _about(law, fitted_to_all(every, law))))
    return law


def _trials(every: Sequence[NearRest], effect: Effect, grid: Mapping[str, Array]) -> Law:
    """Trials of all combinations of the values in a grid, and of smoothing velocities ``width`` if the law has one."""
    values = [dict(zip(grid, map(float, one))) for one in itertools.product(*grid.values())]
    if effect.rate is not None:
        # friction with a state reverses by its own dynamics, without smoothing; its damping multiplies a column
        fixed = [p.name for p in effect.parameters if p.fixed]
        none, unit = (dict.fromkeys(fixed, size) for size in (0.0, 1.0))
        offset = [_laws(one, effect, [{**v, **none} for v in values]) for one in every]
        column = [_laws(one, effect, [{**v, **unit} for v in values]) - of for one, of in zip(every, offset)]
        return Law(effect.name, values, offset, column)
    size = {p.name: 1.0 for p in effect.linear}
    column = [_laws(one, effect, [{**size, **v} for v in values]) for one in every]
    widths = np.array([v["width"] for v in values])
    once, place = np.unique(widths, return_inverse=True)
    return Law(effect.name, values, [one.of(one.smoothed(once)).T[place] for one in every], column)


def _laws(one: NearRest, effect: Effect, values: Sequence[dict[str, float]]) -> Array:
    """(T, r) over std: the law with each of these parameters and smoothing velocities."""
    torque = [one.of_law(effect, {k: x for k, x in v.items() if k != "width"}, v.get("width")) for v in values]
    return one.of(np.stack(torque, axis=1)).T


def _grid(every: Sequence[NearRest], effect: Effect) -> dict[str, Array]:
    """Values of the searched parameters from the catalogue; stiffnesses of bristles as far as encoders resolve them."""
    one = every[0]
    drive = one.run.arm.joints[one.joint - 1]
    grid = {p.name: np.array(p.search) for p in effect.parameters if p.search and not p.fixed}
    for p in effect.parameters:
        if p.scale is Scale.YIELD:
            noise, travel = (max(of(part.run, one.joint) for part in every) for of in (position_noise, _travel))
            stiffest = max(drive.rest_friction) / max(RESOLVED * noise, min(p.shares) * travel)
            softest = min(min(p.search), max(drive.rest_friction) / (SOFTEST * travel))
            grid[p.name] = np.geomspace(softest, max(stiffest, 2.0 * softest), STIFFNESSES)
    if effect.rate is None:
        grid["width"] = WIDTHS * drive.sign_velocity
    return grid


def _travel(run: Run, joint: int) -> float:
    """rad (m): travel of a joint (from 1)."""
    return float(np.ptp(run.raw[1][:, joint - 1]))


def _about(law: Law, best: Mapping[str, float]) -> dict[str, Array]:
    """Values between the best of a law's trials and its neighbours on either side."""
    grid = {}
    for name in law.values[0]:
        known = np.unique([values[name] for values in law.values])
        place = int(np.searchsorted(known, best[name]))
        ends = known[max(place - 1, 0)], known[min(place + 1, len(known) - 1)]
        grid[name] = np.geomspace(*ends, BETWEEN)
    return grid


def _both(one: Law, other: Law) -> Law:
    """All trials of two laws of the same effect."""
    offset, column = (
        [np.concatenate(pair) for pair in zip(*parts)]
        for parts in ((one.offset, other.offset), (one.column, other.column))
    )
    return Law(one.effect, [*one.values, *other.values], offset, column)


def confused(every: Sequence[NearRest], joint: int, library: Sequence[Candidate]) -> Law:
    """Candidates of other effects at the joint that may be confused with friction near rest."""
    names = {name for effect in friction_near_rest() for name in effect.confused_with}
    near_rest_effects = {effect.name for effect in friction_near_rest()}
    chosen = [c for c in library if c.joint == joint and c.effect in names - near_rest_effects]
    column = [
        one.without_nuisance(np.hstack([_at_joint(c, one) for c in chosen]) / one.std[:, None]).T
        if chosen
        else np.zeros((1, len(one.residual)))
        for one in every
    ]
    return Law(None, [dict(c.shape) for c in chosen], [np.zeros_like(part) for part in column], column)


def _at_joint(candidate: Candidate, one: NearRest) -> Array:
    """(r, c) A: columns of a candidate at its joint."""
    return own_columns(candidate, one.run)[one.rows].reshape(len(one.std), -1)


def fitted_to_all(every: Sequence[NearRest], law: Law) -> dict[str, float]:
    """Parameters of the trial that fits all recordings best; coefficients of 0 where another smoothing does as well."""
    assert law.effect is not None
    trial, c = _fitted(*(part.sum(axis=0) for part in _products(every, law)))
    return {**law.values[trial], **dict.fromkeys(coefficients(CATALOGUE[law.effect]), c)}


def coefficients(effect: Effect) -> list[str]:
    """Linear parameters of a law: its scale, and the factor of a further column (the damping of bristles)."""
    return [p.name for p in effect.parameters if (p.fixed if effect.rate is not None else p.linear and not p.term)]


def torque_of(one: NearRest, effect: Effect, values: dict[str, float]) -> Array:
    """(k,) N m: the law with its parameters, and the smoothing velocity that goes with it."""
    of_effect = {name: value for name, value in values.items() if name != "width"}
    if "width" not in values:
        return one.of_law(effect, of_effect)
    return one.smoothed(np.array([values["width"]]))[:, 0] + one.of_law(effect, of_effect, values["width"])
