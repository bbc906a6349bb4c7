"""Causes seen between motor and link encoder, where a recording has both.

Forward selection as for the currents: the shape of a candidate is chosen on the fit recordings, whether it is a cause on the held-out ones. Where
both are parts of the same recordings, each part is predicted from the other, so that a short run has blocks enough to judge by.
A constant is always free (no two encoders are zeroed alike) and named last, where it is large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from daq.recording import Recording
from diagnosis.cause import EffectKey
from diagnosis.measurements.link_encoders.columns import (
    Seen,
    Shape,
    columns,
    joints_with_both,
    see_links,
    shapes,
    standing_orders,
)
from identification.selection.significance import BLOCK_SECONDS, benjamini_hochberg, p_value

SIGNIFICANT = 0.05
"""False-discovery rate at which a candidate may enter."""
MATTERS = 0.2
"""Share of the squared difference left at a joint that a cause must explain."""
OVER_NOISE = 3.0
"""Times the scatter from row to row: what is left below is noise."""
MOST = 20
SHORTEST = 0.3
"""s: blocks are twice as long as what is left is correlated, from this on to those of ``significance``: a run of ten seconds has few long ones."""


@dataclass(frozen=True)
class Sides:
    """Fit and held-out rows. both_ways: they are parts of the same recordings, and each is predicted from the other.

    whole: the rows that what is named is measured on: those of fit, or where they are parts of the same recordings, all.
    scale (k,) rad: spread of each joint's difference, so that joints weigh alike.
    """

    fit: Seen
    held_out: Seen
    whole: Seen
    both_ways: bool
    scale: Array
    cache: dict[tuple[int, Shape, int], Array] = field(default_factory=dict, repr=False)

    def ways(self) -> list[tuple[Seen, Seen]]:
        """(learned from, judged on)."""
        return [(self.fit, self.held_out), *([(self.held_out, self.fit)] if self.both_ways else [])]

    def columns(self, shape: Shape, seen: Seen, k: int) -> Array:
        """``link_columns.columns``, each computed once."""
        key = (id(seen), shape, k)
        if key not in self.cache:
            self.cache[key] = columns(shape, seen, k)
        return self.cache[key]


@dataclass(frozen=True)
class Look:
    """One candidate beside the named ones: fall of the held-out squared error in units of the joints' scales, its share of what was left
    where it is felt, its significance, and the part of the gain on the held-out side itself."""

    shape: Shape
    gain: float
    share: float
    p: float
    ahead: float


def sides_of(arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording]) -> Sides | None:
    """Both sides' rows; None where no joint has a link encoder in all recordings."""
    joints = joints_with_both([*fit, *held_out])
    if len(joints) == 0:
        return None
    same = bool({r.path for r in fit} & {r.path for r in held_out})
    every = see_links([*fit, *held_out], arm, joints)
    fitted, judged = (replace(see_links(side, arm, joints), largest=every.largest) for side in (fit, held_out))
    scale = np.maximum(np.std(every.difference, axis=0), fitted.noise)
    return Sides(fitted, judged, every if same else fitted, same, scale)


def select(sides: Sides) -> list[Shape]:
    """Causes in the order of acceptance."""
    everything = list(shapes(sides.fit))
    chosen: list[Shape] = []
    while len(chosen) < MOST:
        looks = [look(shape, chosen, sides) for shape in best_shapes(everything, chosen, sides)]
        q = benjamini_hochberg(np.array([one.p for one in looks]))
        left = sides_error(chosen, sides)
        able = [
            one
            for one, q_one in zip(looks, q)
            if q_one < SIGNIFICANT
            and one.share > MATTERS
            and one.ahead > 0.0
            and _over_noise(one.shape, left, sides)
            and physical(one.shape, chosen, sides)
        ]
        if not able:
            break
        chosen.append(max(able, key=lambda one: one.gain).shape)
        chosen = [s for s in chosen if look(s, [o for o in chosen if o is not s], sides).share > MATTERS / 2]
    return chosen


def look(shape: Shape, chosen: Sequence[Shape], sides: Sides) -> Look:
    """What one candidate adds beside the chosen ones on the held-out side (on either side, predicted from the other)."""
    felt = [k for k, joint in enumerate(sides.fit.joints) if shape.joint in (None, joint)]
    left, correlated, falls = 0.0, 0.0, []
    for learned, judged in sides.ways():
        before, after = (
            residual(some, learned, judged, sides)[:, felt] / sides.scale[felt] for some in (chosen, [*chosen, shape])
        )
        left += float(np.sum(before**2))
        correlated = max(correlated, _correlated(after, float(judged.t[1] - judged.t[0])))
        falls.append((judged, before**2 - after**2))
    seconds = float(np.clip(2.0 * correlated, SHORTEST, BLOCK_SECONDS))
    gains = np.concatenate([np.bincount(j.blocks(seconds), weights=fall) for j, falling in falls for fall in falling.T])
    gain, ahead = float(gains.sum()), float(falls[0][1].sum())
    return Look(shape, gain, gain / max(left, 1e-300), p_value(gains), ahead)


def _correlated(rest: Array, dt: float) -> float:
    """s over which the column of ``rest`` (m, k) that does so longest is correlated to more than 1 / e."""
    rest = rest - rest.mean(axis=0)
    power = np.abs(np.fft.rfft(rest, 2 * len(rest), axis=0)) ** 2
    with_itself = np.fft.irfft(power, axis=0)[: len(rest)]
    return float(np.max(np.argmax(with_itself < np.exp(-1.0) * with_itself[0], axis=0))) * dt


def best_shapes(everything: Sequence[Shape], chosen: Sequence[Shape], sides: Sides) -> list[Shape]:
    """For each effect at each joint, the shape that fits best beside what is named; an effect named already may come again as
    another order only."""
    taken = {(s.effect, s.joint) for s in chosen if s.name != "order"} | {(s.effect, s.joint, s.value) for s in chosen}
    best: dict[EffectKey, tuple[float, Shape]] = {}
    for k, joint in enumerate(int(j) for j in sides.fit.joints):
        x = np.column_stack([np.ones(sides.fit.rows), *(sides.columns(s, sides.fit, k) for s in chosen)])
        basis = np.linalg.qr(x / np.linalg.norm(x, axis=0))[0]
        rest = _off(basis, sides.fit.difference[:, k])
        waves = {s.effect for s in everything if s.name == "order"}
        standing = [Shape(w, joint, "order", order) for w in waves for order in standing_orders(rest, sides.fit, k)]
        for shape in [*everything, *standing]:
            key = (shape.effect, shape.joint)
            if shape.joint != joint or key in taken or (*key, shape.value) in taken:
                continue
            seen = _off(basis, sides.columns(shape, sides.fit, k))
            gain = float(np.sum((np.linalg.qr(seen)[0].T @ rest) ** 2))
            if key not in best or gain > best[key][0]:
                best[key] = gain, shape
    everywhere = [s for s in everything if s.joint is None and (s.effect, None) not in taken]
    return everywhere + [shape for _, shape in best.values()]


def _off(basis: Array, columns: Array) -> Array:
    return columns - basis @ (basis.T @ columns)


def stacked(chosen: Sequence[Shape], seen: Seen, sides: Sides) -> Array:
    """(k m, c) columns over the joints' scales, joint after joint: a constant a joint, then those of every shape."""
    joints = len(seen.joints)
    width = joints + sum(s.width for s in chosen)
    x = np.zeros((joints, seen.rows, width))
    for k in range(joints):
        x[k, :, k] = 1.0
        at = joints
        for shape in chosen:
            own = sides.columns(shape, seen, k)
            x[k, :, at : at + own.shape[1]] = own
            at += shape.width
        x[k] /= sides.scale[k]
    return x.reshape(joints * seen.rows, width)


def coefficients(chosen: Sequence[Shape], seen: Seen, sides: Sides) -> Array:
    """(c,) least squares of all joints together."""
    x = stacked(chosen, seen, sides)
    y = (seen.difference / sides.scale).T.ravel()
    size = np.linalg.norm(x, axis=0)
    size[size == 0.0] = 1.0
    x = x / size
    found: Array = np.linalg.lstsq(x.T @ x, x.T @ y, rcond=1e-11)[0] / size
    return found


def residual(chosen: Sequence[Shape], learned: Seen, judged: Seen, sides: Sides) -> Array:
    """(m, k) rad: difference of ``judged`` less what is predicted from ``learned``; its own constant is free."""
    predicted = (
        (stacked(chosen, judged, sides) @ coefficients(chosen, learned, sides)).reshape(len(judged.joints), -1).T
    )
    rest = judged.difference - predicted * sides.scale
    return rest - rest.mean(axis=0)


def sides_error(chosen: Sequence[Shape], sides: Sides) -> Array:
    """(k,) rad: rms of what is left of the held-out difference."""
    rms: Array = np.sqrt(np.mean(residual(chosen, sides.fit, sides.held_out, sides) ** 2, axis=0))
    return rms


def _over_noise(shape: Shape, left: Array, sides: Sides) -> bool:
    felt = [k for k, joint in enumerate(sides.fit.joints) if shape.joint in (None, joint)]
    return bool(np.any(left[felt] > OVER_NOISE * sides.fit.noise[felt]))


def physical(shape: Shape, chosen: Sequence[Shape], sides: Sides) -> bool:
    """Whether a stiffness or a gap comes out positive."""
    if shape.definition.spring is None:
        return True
    return bool(coefficients([*chosen, shape], sides.fit, sides)[-1] > 0.0)
