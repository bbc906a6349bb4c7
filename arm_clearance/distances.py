"""Distances of segments from segments and boxes, exact, over arrays.

Segment to segment after C. Ericson, Real-Time Collision Detection, 2005, 5.1.9. The squared distance from a box along a
segment is convex and piecewise quadratic in the place on it, so that its derivative, linear between the crossings of
the box's planes, has its zero where it changes its sign.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array

POINT = 1e-12
"""m2: of a squared length below it a segment is a point."""


def segment_to_segment(p1: Array, q1: Array, p2: Array, q2: Array) -> Array:
    """(...,) m between the segments from p1 to q1 and from p2 to q2, (..., 3) each."""
    d1, d2, r = q1 - p1, q2 - p2, p1 - p2
    a, e, f = _dot(d1, d1), _dot(d2, d2), _dot(d2, r)
    b, c = _dot(d1, d2), _dot(d1, r)
    long1, long2 = np.where(a > POINT, a, 1.0), np.where(e > POINT, e, 1.0)
    crossing = a * e - b * b
    skew = crossing > 1e-12 * a * e
    s = np.where(skew, np.clip((b * f - c * e) / np.where(skew, crossing, 1.0), 0.0, 1.0), 0.0)
    s = np.where(a > POINT, s, 0.0)
    t = np.where(e > POINT, (b * s + f) / long2, 0.0)
    t = np.clip(t, 0.0, 1.0)
    s = np.where(a > POINT, np.clip((b * t - c) / long1, 0.0, 1.0), 0.0)
    apart = r + s[..., None] * d1 - t[..., None] * d2
    return np.sqrt(_dot(apart, apart))


def segment_to_box(p: Array, q: Array, low: Array, high: Array) -> Array:
    """(...,) m between the segments from p to q (..., 3) and boxes with corners low and high (..., 3); 0 inside."""
    d = q - p
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = np.concatenate([(low - p) / d, (high - p) / d], axis=-1)
    crossings = np.clip(np.nan_to_num(crossings, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    ends = np.broadcast_to(np.array([0.0, 1.0]), (*crossings.shape[:-1], 2))
    places = np.sort(np.concatenate([crossings, ends], axis=-1), axis=-1)
    at = p[..., None, :] + places[..., None] * d[..., None, :]
    outside = at - np.clip(at, low[..., None, :], high[..., None, :])
    slope = (outside * d[..., None, :]).sum(axis=-1)
    after = np.clip((slope < 0.0).sum(axis=-1, keepdims=True), 1, places.shape[-1] - 1)
    left, right = (np.take_along_axis(places, after - k, axis=-1) for k in (1, 0))
    below, above = (np.take_along_axis(slope, after - k, axis=-1) for k in (1, 0))
    rise = above - below
    share = np.clip(-below / np.where(rise > 0.0, rise, 1.0), 0.0, 1.0)
    place = left + share * (right - left)
    nearest = p + place * d
    apart = nearest - np.clip(nearest, low, high)
    return np.sqrt(_dot(apart, apart))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=-1))
