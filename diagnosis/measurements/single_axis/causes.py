"""Causes at one axis alone, with an encoder fine enough to judge reversals (``diagnosis.measurements.single_axis.columns``).

Forward selection: shapes and coefficients from the fit rows, acceptance by the held-out ones. Parts of one recording are predicted from each other.
A drive that repeats one motion would confirm anything that repeats with it. So what is not itself a difference between the directions has to
hold across them too: each direction is predicted from what the other one shows. And a wave over the place is named only where other
recordings show it at the same places: where a scale has its zero, and in which turn its screw then stands, a run cannot tell by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import CATALOGUE
from arm_model.effects.definition import SYSTEMATIC
from diagnosis.cause import Estimate
from diagnosis.measurements.single_axis.columns import DELAY, Rows, Shape, columns, fine, rows_of, shapes, waves
from diagnosis.residual.expected_current import low_pass
from diagnosis.units import unit_at
from identification.selection.cluster_covariance import cluster_covariance
from identification.selection.least_squares import scaled_lstsq
from identification.selection.significance import benjamini_hochberg, p_value

Samples = tuple[Array, Array, Array]

SIGNIFICANT = 0.05
"""False-discovery rate at which a candidate may enter."""
MATTERS = 0.08
"""Share of what is left that a cause must explain."""
ALIKE = 0.95
"""A candidate that explains this share of what the named one does is in its group."""
BLOCK_SECONDS = 0.3
MOST = 6
SMALL = 1e-4
"""Share of a nonlinear parameter over which columns are differentiated."""
PRESLIDING = (0.6, 1.6)
"""Friction that builds up gradually is the model's own: a coefficient outside says that it is not what is seen."""
TURN = 2e-3
"""Of an axis's speed: the velocity over which friction turns round, at most."""


@dataclass(frozen=True)
class AxisCause:
    """One cause; before, after: rms of the held-out residual without and with it, A; gains (blocks,): fall of its square; without (m,) A: that
    residual without it, row by row."""

    effect: str
    parameters: list[Estimate]
    p: float
    before: float
    after: float
    group: tuple[str, ...]
    gains: Array
    without: Array


@dataclass(frozen=True)
class StandingWave:
    """A force that goes with the sine of the place in one run: length m (rad), amplitude N (N m), and the share of what is left that either part of
    the run predicts of the other."""

    length: float
    amplitude: float
    share: float


@dataclass(frozen=True)
class AxisSide:
    """Causes in the order of acceptance; the wave that no second run confirms, if there is one; the held-out rows, and what all causes leave of
    them (m,) A."""

    causes: list[AxisCause]
    wave: StandingWave | None
    seen: Rows
    left: Array


@dataclass(frozen=True)
class _Sides:
    """whole: the rows that what is named is measured on: those of fit, or where both are parts of the same recordings, all; one_run: nothing is held
    out but what one run went on with, whether it was cut here or into tables before."""

    fit: Rows
    held_out: Rows
    whole: Rows
    both_ways: bool
    one_run: bool
    cache: dict[tuple[int, Shape], Array]

    def columns(self, shape: Shape, rows: Rows) -> Array:
        key = (id(rows), shape)
        if key not in self.cache:
            self.cache[key] = columns(shape, rows)
        return self.cache[key]

    def stacked(self, chosen: Sequence[Shape], rows: Rows) -> Array:
        return np.column_stack([np.empty((len(rows.residual), 0)), *(self.columns(s, rows) for s in chosen)])

    def ways(self) -> list[tuple[Rows, Rows]]:
        return [(self.fit, self.held_out), *([(self.held_out, self.fit)] if self.both_ways else [])]


def sharply(arm: Arm, recordings: Sequence[Samples]) -> Arm:
    """The arm of one axis with friction that turns round within TURN of its speed, where the model's turns more slowly than that.

    Over which velocity the sign of friction is smoothed is chosen for simulation, seldom measured; as wide as a stroke's start it would hide
    what friction does there.
    """
    speed = max(
        float(np.max(np.abs(np.diff(low_pass(q, 20.0, _rate(t)), axis=0)))) * _rate(t) for t, q, _ in recordings
    )
    joint = arm.joints[0]
    return replace(arm, joints=(replace(joint, sign_velocity=min(joint.sign_velocity, max(TURN * speed, 1e-9))),))


def _rate(t: Array) -> float:
    return 1.0 / float(np.median(np.diff(t)))


def axis_side(arm: Arm, fit: Sequence[Samples], held_out: Sequence[Samples], *, parts: bool) -> AxisSide | None:
    """Causes, and what stands beside them; None where the arm is not one axis, or its encoder too coarse to say more than filters leave.

    fit, held_out: recordings (t (k,) s uniform, q (k, 1), i (k, 1)); parts: they are parts of the same recordings.
    """
    if len(arm) != 1:
        return None
    arm = sharply(arm, [*fit, *held_out])
    judged, learned = rows_of(arm, held_out, BLOCK_SECONDS), rows_of(arm, fit, BLOCK_SECONDS)
    whole = rows_of(arm, [*fit, *held_out], BLOCK_SECONDS) if parts else learned
    sides = _Sides(learned, judged, whole, parts, parts or _goes_on(fit, held_out), {})
    if not fine(arm, sides.fit):
        return None
    chosen = _select(sides)
    left = _left(chosen, sides.fit, sides.held_out, sides)
    return AxisSide([_cause(shape, chosen, sides) for shape in chosen], _wave(chosen, sides), sides.held_out, left)


def _goes_on(fit: Sequence[Samples], held_out: Sequence[Samples]) -> bool:
    """Whether all that is held out begins or ends where one of the others ends or begins, to within two rows of its motion: pieces of one run."""

    def meet(one: Samples, other: Samples) -> bool:
        (_, q, _), (_, p, _) = one, other
        step = max(float(np.abs(np.diff(x[:, 0])[[0, -1]]).max()) for x in (q, p)) + np.ptp(q) * 1e-6
        return bool(min(abs(q[-1, 0] - p[0, 0]), abs(p[-1, 0] - q[0, 0])) < 2 * step)

    return all(any(meet(one, other) for other in fit) for one in held_out)


def _select(sides: _Sides) -> list[Shape]:
    everything = list(shapes(sides.fit))
    chosen: list[Shape] = []
    while len(chosen) < MOST:
        looks = [(shape, _gains(shape, chosen, sides)) for shape in _best_shapes(everything, chosen, sides)]
        q = benjamini_hochberg(np.array([p_value(gains) for _, (gains, _) in looks]))
        able = [
            (float(gains.sum()), shape)
            for (shape, (gains, share)), q_one in zip(looks, q)
            if q_one < SIGNIFICANT
            and share > MATTERS
            and _physical(shape, chosen, sides)
            and _holds(shape, chosen, sides)
            and not (CATALOGUE[shape.effect].wave and sides.one_run)
        ]
        if not able:
            break
        chosen.append(max(able, key=lambda one: one[0])[1])
        chosen = [_sharpened(s, [o for o in chosen if o is not s], sides) for s in chosen]
        chosen = [s for s in chosen if _gains(s, [o for o in chosen if o is not s], sides)[1] > MATTERS / 2]
    return chosen


def _best_shapes(everything: Sequence[Shape], chosen: Sequence[Shape], sides: _Sides) -> list[Shape]:
    taken = {s.effect for s in chosen}
    best: dict[str, tuple[float, Shape]] = {}
    for shape in [*everything, *waves(_left(chosen, sides.fit, sides.fit, sides), sides.fit)]:
        if shape.effect not in taken:
            left = float(np.sum(_left([*chosen, shape], sides.fit, sides.fit, sides) ** 2))
            if shape.effect not in best or left < best[shape.effect][0]:
                best[shape.effect] = left, shape
    return [shape for _, shape in best.values()]


def _gains(shape: Shape, chosen: Sequence[Shape], sides: _Sides) -> tuple[Array, float]:
    """Fall of the squared held-out error by block, and as a share of what was left; 0 where the held-out side itself gains nothing."""
    falls, left = [], 0.0
    for learned, judged in sides.ways():
        before, after = (_left(some, learned, judged, sides) for some in (chosen, [*chosen, shape]))
        falls.append(np.bincount(judged.block, weights=before**2 - after**2).astype(float))
        left += float(np.sum(before**2))
    gains = np.concatenate(falls)
    share = float(gains.sum()) / max(left, 1e-300)
    return gains, share if falls[0].sum() > 0 else 0.0


def _left(chosen: Sequence[Shape], learned: Rows, judged: Rows, sides: _Sides) -> Array:
    return np.asarray(judged.residual - sides.stacked(chosen, judged) @ _fitted(chosen, learned, sides), float)


def _fitted(chosen: Sequence[Shape], rows: Rows, sides: _Sides, where: NDArray[np.bool_] | None = None) -> Array:
    x, y = sides.stacked(chosen, rows), rows.residual
    if where is not None:
        x, y = x[where], y[where]
    return scaled_lstsq(x, y)


def _physical(shape: Shape, chosen: Sequence[Shape], sides: _Sides) -> bool:
    """Friction at rest not below nothing; gradual friction the model's own; a share of friction between none and all of it."""
    c = float(_fitted([*chosen, shape], sides.fit, sides)[-1])
    level = sides.fit.arm.joints[0].ratio * max(sides.fit.arm.joints[0].coulomb)
    effect = CATALOGUE[shape.effect]
    if effect.unit_amplitude:
        return PRESLIDING[0] < c < PRESLIDING[1]
    if not effect.linear or effect.span is not None:
        return True
    parameter = effect.linear[-1]
    return c > -level if parameter.unit == "N m" and not parameter.signed else effect.admits(parameter.name, c)


def _holds(shape: Shape, chosen: Sequence[Shape], sides: _Sides) -> bool:
    """Whether what one direction shows of it predicts the other, on both."""
    if CATALOGUE[shape.effect].directional:
        return True
    for rows in (sides.fit, sides.held_out):
        before = rows.residual - sides.stacked(chosen, rows) @ _fitted(chosen, rows, sides)
        own = sides.columns(shape, rows)
        rest = own - sides.stacked(chosen, rows) @ np.linalg.lstsq(sides.stacked(chosen, rows), own, rcond=1e-9)[0]
        for learned in (rows.v > 0, rows.v < 0):
            c = np.linalg.lstsq(rest[learned], before[learned], rcond=1e-9)[0]
            judged = ~learned
            if np.sum((before[judged] - rest[judged] @ c) ** 2) >= np.sum(before[judged] ** 2):
                return False
    return True


def _sharpened(shape: Shape, others: Sequence[Shape], sides: _Sides) -> Shape:
    """Each nonlinear parameter at its best between its neighbours on the grid."""
    for name, value in shape.values:
        if value <= 0.0:
            continue

        def worse(log_value: float, name: str = name, now: Shape = shape) -> float:
            return float(np.sum(_residual_of(_with(now, name, float(np.exp(log_value))), others, sides) ** 2))

        reach = 2.0
        if CATALOGUE[shape.effect].wave:  # half a wave in the travel: beyond, another one fits
            reach = 1.0 + np.pi / (value * sides.fit.arm.joints[0].ratio * float(np.ptp(sides.fit.q)))
        found = optimize.minimize_scalar(
            worse, bounds=(np.log(value / reach), np.log(value * reach)), method="bounded", options={"maxiter": 12}
        )
        if found.fun < worse(float(np.log(value))):
            shape = _with(shape, name, float(np.exp(found.x)))
    return shape


def _with(shape: Shape, name: str, value: float) -> Shape:
    return replace(shape, values=tuple((n, value if n == name else v) for n, v in shape.values))


def _residual_of(shape: Shape, others: Sequence[Shape], sides: _Sides) -> Array:
    x = np.column_stack([sides.stacked(others, sides.fit), columns(shape, sides.fit)])
    return np.asarray(sides.fit.residual - x @ np.linalg.lstsq(x, sides.fit.residual, rcond=1e-9)[0], float)


def _wave(chosen: Sequence[Shape], sides: _Sides) -> StandingWave | None:
    """The strongest wave over the place that one run has beside its causes, where its parts and its directions agree on it."""
    if not sides.one_run:
        return None
    for shape in waves(_left(chosen, sides.fit, sides.fit, sides), sides.fit, 1):
        gains, share = _gains(shape, chosen, sides)
        if p_value(gains) < SIGNIFICANT and share > MATTERS and _holds(shape, chosen, sides):
            drive, number = sides.whole.arm.joints[0], shape.values[0][1]
            sine, cosine = _fitted([*chosen, shape], sides.whole, sides)[-2:]
            return StandingWave(2 * np.pi / number / drive.ratio, float(np.hypot(sine, cosine)), share)
    return None


def _cause(shape: Shape, chosen: list[Shape], sides: _Sides) -> AxisCause:
    others = [s for s in chosen if s is not shape]
    gains, _ = _gains(shape, others, sides)
    without, having = (_left(some, sides.fit, sides.held_out, sides) for some in (others, chosen))
    before, after = (float(np.sqrt(np.mean(values**2))) for values in (without, having))
    group = [shape.effect]
    named, width = {s.effect for s in chosen}, sides.columns(shape, sides.fit).shape[1]
    for other in _best_shapes(list(shapes(sides.fit)), others, sides):
        simpler = other.effect not in named and sides.columns(other, sides.fit).shape[1] <= width
        if simpler and _physical(other, others, sides) and _gains(other, others, sides)[0].sum() > ALIKE * gains.sum():
            group.append(other.effect)
    return AxisCause(
        shape.effect, _parameters(shape, chosen, sides), p_value(gains), before, after, tuple(group), gains, without
    )


def _parameters(shape: Shape, chosen: list[Shape], sides: _Sides) -> list[Estimate]:
    """Values, and standard deviations by the sandwich of the cells' scores, nonlinear parameters among the columns."""
    rows, x = sides.whole, sides.stacked(chosen, sides.whole)
    c = _fitted(chosen, rows, sides)
    at = sum(sides.columns(s, rows).shape[1] for s in chosen[: chosen.index(shape)])
    own = c[at : at + sides.columns(shape, rows).shape[1]]
    slopes = [
        (columns(_with(shape, name, (1.0 + SMALL) * value), rows) - sides.columns(shape, rows)) @ own / (SMALL * value)
        for name, value in shape.values
        if value > 0.0
    ]
    left = rows.residual - x @ c
    covariance = cluster_covariance(np.column_stack([x, *slopes]), [left], rows.cells)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    effect = CATALOGUE[shape.effect]
    unit_of = {p.name: unit_at(rows.arm.joints[0], p.unit, p.name) for p in effect.parameters}
    if effect.delay is not None:
        return [Estimate("delay", float(own[0]) * DELAY, float(std[at]) * DELAY, "s")]
    if effect.span is not None and effect.span.span is not None:
        name, spanned = effect.linear[0].name, effect.span.name
        size, value = effect.span.span.solve(float(own[0]), float(own[1]))
        if not effect.wave:
            return [
                Estimate(name, size, float(np.hypot(std[at], std[at + 1])), unit_of[name]),
                Estimate(spanned, value, float(std[at + 1]) / abs(size), unit_of[spanned]),
            ]
        return [
            Estimate(name, size, float(np.max(std[at : at + 2])), unit_of[name]),
            Estimate(shape.values[0][0], shape.values[0][1], float(std[-1]), "1"),
            Estimate(spanned, value, float(np.max(std[at : at + 2])) / max(size, 1e-12), unit_of[spanned]),
        ]
    names = [p.name for p in effect.linear]
    found = [
        Estimate(name, float(value), float(np.hypot(s, SYSTEMATIC * value)), unit_of[name])
        for name, value, s in zip(names, own, std[at:])
    ]
    curved = [(name, value) for name, value in shape.values if value > 0.0]
    return found + [
        Estimate(name, value, float(np.hypot(s, SYSTEMATIC * value)), unit_of[name])
        for (name, value), s in zip(curved, std[x.shape[1] :])
    ]
