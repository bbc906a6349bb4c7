"""Tracked points with the motion of the joints at the same rows, wrong points removed and counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.signal import savgol_filter

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import described
from arm_model.rigid_body import rigid_torque
from arm_model.tracking import bends, latency, lost_motion
from daq.recording import Recording
from diagnosis.residual.run_setup import loaded, setup_of
from identification.selection import BLOCK_SECONDS, MAD_TO_STD, MEDIAN_OF_NORM

Mask = NDArray[np.bool_]

MOST = 6000
"""Points of either set that are used; more are evenly thinned."""
WRONG = 8.0
"""Noise std from the median of its neighbours above which a point is wrong; Gaussian noise: once in 1e13."""
NEIGHBOURS = 7
"""Points, itself among them, whose median a point is compared with."""
AROUND = 3 * NEIGHBOURS
"""Points whose usual distance from their neighbours a wrong point exceeds as well."""
RATES = 0.1
"""s: length of the local cubics whose slopes are speed and acceleration."""


@dataclass(frozen=True)
class Side:
    """Tracked points of some recordings (fit or held out), N of them.

    q (N, n) rad (m): angles of the links as read, with what the model's own effects make of them where the tracker
    looks; xyz (N, 3) m; v, a (N, n) per second and its square; load (N, n) N m: what the transmissions carry in motion;
    holding (N, n) N m: the torque to the links at rest; motor (N, n) rad: of the motors themselves; t (N,) s in its
    recording; block (N,) of a second each; of (N,) index of its recording; rigid: the arm without effects in each
    recording; coupling (n, n): turn of each link by that of each motor
    """

    q: Array
    xyz: Array
    v: Array
    a: Array
    load: Array
    holding: Array
    motor: Array
    t: Array
    block: NDArray[np.intp]
    of: NDArray[np.intp]
    rigid: tuple[Arm, ...]
    coupling: Array

    def __len__(self) -> int:
        return len(self.q)

    def turned(self, by: Array) -> Side:
        """The side with the torques of links that are turned ``by`` (N, n) rad more than the angles that are read."""
        load, holding = np.empty_like(self.load), np.empty_like(self.holding)
        for k, arm in enumerate(self.rigid):
            rows = self.of == k
            load[rows], holding[rows] = _torques(arm, (self.q + by)[rows], self.v[rows], self.a[rows])
        return replace(self, load=load, holding=holding)

    @property
    def moves_alone(self) -> Mask:
        """(n,) whether a motor moves its own link only, one to one."""
        return np.asarray((self.coupling == np.eye(len(self.coupling))).all(axis=0))


@dataclass(frozen=True)
class Outliers:
    """Numbers of wrong, missing and expected points, of gaps, and the deviations ``size`` m of the wrong ones."""

    wrong: int
    missing: int
    breaks: int
    expected: int
    size: Array


@dataclass(frozen=True)
class _Rows:
    """One recording's rows: t, q, v, a, and xyz with wrong points NaN; noise m, of one coordinate."""

    t: Array
    q: Array
    v: Array
    a: Array
    xyz: Array
    outliers: Outliers
    noise: float


def points_of(recording: Recording) -> Array | None:
    """(n, 3) m in the base frame, or in the tracker's own where the rig has no pose of it; None without a tracker."""
    xyz = recording.xyz if recording.xyz is not None else recording.points
    return None if xyz is None or np.isfinite(xyz).all(axis=1).sum() < NEIGHBOURS else xyz


def side_of(
    arm: Arm, recordings: Sequence[Recording], angles: Sequence[Array], nominal: Sequence[Array]
) -> tuple[Side, list[Outliers], float]:
    """The points of recordings (all with a tracker), their outliers, and the noise of a coordinate, m.

    angles: (rows, n) rad of the links per recording; nominal: where the model has the target, (rows, 3) m per
    recording.
    """
    parts: list[Side] = []
    outliers, noises = [], []
    limit = max(1, MOST // len(recordings))
    for index, (recording, q, at) in enumerate(zip(recordings, angles, nominal, strict=True)):
        xyz = points_of(recording)
        assert xyz is not None
        rows = _rows(recording.t, q, xyz, xyz - at)
        outliers.append(rows.outliers)
        noises.append(rows.noise)
        parts.append(_part(loaded(arm, setup_of(recording).payload), rows, index, limit, parts))
    names = ("q", "xyz", "v", "a", "load", "holding", "motor", "t", "block", "of")
    side = Side(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
        rigid=tuple(arm for part in parts for arm in part.rigid),
        coupling=arm.coupling_matrix,
    )
    return side, outliers, float(np.median(noises))


def _part(arm: Arm, rows: _Rows, index: int, limit: int, before: Sequence[Side]) -> Side:
    usable = np.flatnonzero(np.isfinite(rows.xyz).all(axis=1))
    usable = usable[:: max(1, -(-len(usable) // limit))]
    q, v, a = rows.q[usable], rows.v[usable], rows.a[usable]
    bare = replace(described(arm), effects=())
    late = q - latency(arm) * v
    first = int(before[-1].block[-1]) + 1 if before and len(before[-1].block) else 0
    load, holding = _torques(bare, q, v, a)
    # the deflection of springs that the model has is expected
    links = late - lost_motion(arm, arm.reported_angles(late), load) @ arm.coupling_matrix.T
    return Side(
        q=links + bends(arm, links),
        xyz=rows.xyz[usable],
        v=v,
        a=a,
        load=load,
        holding=holding,
        motor=arm.reported_angles(q) * np.array([joint.ratio for joint in arm.joints]),
        t=rows.t[usable],
        block=first + (rows.t[usable] // BLOCK_SECONDS).astype(np.intp),
        of=np.full(len(usable), index),
        rigid=(bare,),
        coupling=arm.coupling_matrix,
    )


def _torques(rigid: Arm, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """(N, n) N m: what transmissions carry in motion, and what holds the links at rest, without effects."""
    return rigid_torque(rigid, q, v, a) @ rigid.coupling_matrix, rigid_torque(rigid, q, 0 * q, 0 * q)


def _rows(t: Array, q: Array, xyz: Array, off: Array) -> _Rows:
    v, a = _rates(t, q)
    tracked = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    away = off[tracked]
    # noise from second differences, since errors of the arm are smooth
    second = (away[:-2] - 2 * away[1:-1] + away[2:]) / np.sqrt(6.0)
    noise = float(MAD_TO_STD * np.median(np.abs(second))) if len(second) else 0.0
    deviation = away - ndimage.median_filter(away, size=(NEIGHBOURS, 1), mode="nearest")
    distance = np.linalg.norm(deviation, axis=1)
    # a fast wave moves all points of a stretch away from their neighbours, wrong points are single ones
    near = np.maximum(float(np.median(distance)), ndimage.median_filter(distance, AROUND, mode="nearest"))
    wrong = distance > WRONG * np.maximum(near / MEDIAN_OF_NORM, max(noise, 1e-9))
    steps = np.diff(tracked)
    usual = int(np.median(steps)) if len(steps) else 1
    gaps = steps[steps > 3 * usual]
    missing = int(np.sum(gaps // usual - 1))
    good = xyz.copy()
    good[tracked[wrong]] = np.nan
    outliers = Outliers(int(wrong.sum()), missing, len(gaps), len(tracked) + missing, _sizes(away, wrong, noise))
    return _Rows(t, q, v, a, good, outliers, noise)


def _sizes(away: Array, wrong: Mask, noise: float) -> Array:
    """(wrong,) m by which wrong points are off: their distance from the median of the right ones beside them.

    A wrong point draws a median that it is part of towards itself, by a fifth of the noise per coordinate. Noise at
    right angles makes a distance longer. away (N, 3) m: of all points from the model; noise m, of a coordinate.
    """
    reach, sizes = NEIGHBOURS // 2, list[float]()
    for place in np.flatnonzero(wrong).tolist():
        beside = np.arange(max(place - reach, 0), min(place + reach + 1, len(away)))
        right = beside[~wrong[beside]]
        at = np.median(away[right if len(right) else beside], axis=0)
        sizes.append(float(np.sum((away[place] - at) ** 2) - 2.0 * noise**2))
    return np.sqrt(np.maximum(sizes, 0.0))


def _rates(t: Array, q: Array) -> tuple[Array, Array]:
    """Speed and acceleration (rows, n) from local cubics, of rows at an even pace."""
    period = float(np.median(np.diff(t)))
    rows = 2 * int(RATES / 2 / period) + 1
    if rows < 5 or len(q) < rows:
        v = np.gradient(q, t, axis=0)
        return v, np.gradient(v, t, axis=0)
    return (
        savgol_filter(q, rows, 3, deriv=1, delta=period, axis=0),
        savgol_filter(q, rows, 3, deriv=2, delta=period, axis=0),
    )
