"""Motor minus link encoder, row by row.

The difference d = q_motor / gear - q_link needs no dynamics: it contains lost motion, elasticity, gear errors and
differences of the time stamps. Of the arm only the gear ratios are needed; the load comes from its masses where it has
some, else from the measured current.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from arm_io.types import Array
from arm_model import Arm
from arm_model.system import rigid_torque_along
from arm_model.tracking import lost_motion
from daq.recording import Recording
from diagnosis.residual.filters import Motion, low_pass, rate_along
from diagnosis.residual.load_errors import load_errors
from diagnosis.residual.noise.encoder_step import encoder_step
from identification.selection import MAD_TO_STD
from identification.selection.cluster_covariance import numbered_on

Index = NDArray[np.intp]
BAND = 30.0
"""Hz: pass-band of motions and loads; links oscillate on soft springs at 5 to 15 Hz."""
MOST_ROWS = 8000
"""Rows of either set: the difference needs no filter, so that rows may be left out."""
ENDS = 0.1
"""s at either end of a recording that filters spoil: three periods of ``BAND``."""
BORNE = 0.05
"""Share of the largest load that surely holds a link at one side of a gap."""
BY_ROW = ("difference", "q", "v", "load", "load_errors", "t")
"""Fields of ``Rows`` with an entry per row."""


@dataclass(frozen=True)
class Rows:
    """Rows of some recordings one after the other, at the joints (k,) that have both encoders (1-based).

    difference, q, v, load (m, k) rad, rad/s, N m (m, m/s, N); t (m,) s; starts, names: first row and file name of each
    recording;
    noise (k,): std of the difference from row to row and by the steps of the encoders; ratio (k,): abs(gear);
    largest (k,) N m (N): largest load, the same for all rows that are compared;
    load_errors (m, k, r) N m (N): what is not known of the load, by independent errors of the masses.
    """

    joints: Index
    difference: Array
    q: Array
    v: Array
    load: Array
    known_load: bool
    t: Array
    starts: tuple[int, ...]
    names: tuple[str, ...]
    noise: Array
    ratio: Array
    largest: Array
    load_errors: Array

    @property
    def rows(self) -> int:
        """m."""
        return len(self.t)

    @property
    def parts(self) -> list[slice]:
        """The rows of each recording."""
        return [slice(*span) for span in itertools.pairwise([*self.starts, self.rows])]

    @cached_property
    def load_rate(self) -> Array:
        """(m, k) N m/s (N/s): derivative of the load in time."""
        return np.concatenate([np.gradient(self.load[part], self.t[part], axis=0) for part in self.parts])

    @cached_property
    def borne(self) -> NDArray[np.bool_]:
        """(m, k) whether the load holds a link at one side of a gap, also within the resolution of the load in time."""
        borne = np.abs(self.load) >= BORNE * self.largest
        width = 2 * round(1.0 / BAND / float(np.median(np.diff(self.t)))) + 1
        return np.asarray(ndimage.minimum_filter1d(borne.astype(np.int8), width, axis=0) > 0)

    def of(self, name: str) -> Rows:
        """The rows of one recording, all stretches of it."""
        stretches = [part for part, its in zip(self.parts, self.names) if its == name]
        lengths = [part.stop - part.start for part in stretches]
        starts = tuple(np.cumsum([0, *lengths[:-1]]).tolist())
        by_row: dict[str, Any] = {
            field: np.concatenate([getattr(self, field)[part] for part in stretches]) for field in BY_ROW
        }
        return replace(self, **by_row, starts=starts, names=(name,) * len(stretches))

    def blocks(self, seconds: float) -> Index:
        """(m,) number of the block of ``seconds`` that each row is in, from 0; none reaches over two recordings."""
        since = [self.t[part] - self.t[part.start] for part in self.parts]
        return numbered_on([(t // seconds).astype(np.intp) for t in since])


def joints_with_both(recordings: Sequence[Recording], arm: Arm) -> Index:
    """Joints (1-based) that move and whose link encoder has a value in every row of every recording.

    With coupled joints, the encoders of all links from which the motor's angle follows must have one.
    """
    read = [behind(r, arm) for r in recordings]
    if any(one is None for one in read):
        return np.empty(0, np.intp)
    there = np.all([np.isfinite(one).all(axis=0) for one in read if one is not None], axis=0)
    moved = np.any([np.ptp(r.q, axis=0) > 0 for r in recordings], axis=0)
    return np.flatnonzero(there & moved) + 1


def behind(recording: Recording, arm: Arm) -> Array | None:
    """(m, n) rad (m): angles of the motors over their gears, computed from the link encoders; None without any."""
    return None if recording.ql is None else arm.reported_angles(recording.ql)


def rows_of(recordings: Sequence[Recording], arm: Arm, joints: Index) -> Rows:
    """The rows of ``recordings``, thinned to MOST_ROWS; positions must be uniformly sampled and without gaps."""
    parts: list[tuple[Array, ...]] = []
    scatters, steps = [], []
    k = joints - 1
    known_load = bool(np.any(arm.joint_array("mass") > 0))
    stride = max(1, sum(map(len, recordings)) // MOST_ROWS)
    for r in recordings:
        read = behind(r, arm)
        assert read is not None
        rate = 1.0 / r.dt
        v = rate_along(low_pass(r.q, BAND, rate), r.dt)
        motion = _slow(r.q, r.dt)
        if known_load:
            motion = _slow(_links(r.q, read, rigid_torque_along(arm, *motion)), r.dt)
            load = rigid_torque_along(arm, *motion)
        else:
            load = low_pass(r.i, BAND, rate) * arm.joint_array("drive_constant")
        # the deflection of springs that the model has is expected
        own = lost_motion(arm, motion[0], load) if known_load else np.zeros_like(read)
        difference = (r.q - read - own)[:, k]
        scatters.append(MAD_TO_STD * np.median(np.abs(np.diff(difference, 2, axis=0)), axis=0) / np.sqrt(6))
        steps.append([[encoder_step(angles[:, j]) for angles in (r.q, read)] for j in k])
        keep = slice(int(ENDS * rate), -int(ENDS * rate), stride)
        t = r.t[keep]
        errors = load_errors(arm, *(values[keep] for values in motion))
        parts.append((difference[keep], r.q[keep][:, k], v[keep][:, k], load[keep][:, k], t, errors[:, k]))
    starts = np.cumsum([0, *(len(part[0]) for part in parts[:-1])])
    difference, q, v, load, t, errors = (np.concatenate(columns) for columns in zip(*parts))
    return Rows(
        joints,
        difference,
        q,
        v,
        load,
        known_load,
        t,
        tuple(starts.tolist()),
        tuple(r.path.name for r in recordings),
        # a joint at rest shows no step of its encoders, so the step is taken from where it moves
        np.sqrt(np.mean(np.square(scatters), axis=0) + np.sum(np.max(steps, axis=0) ** 2, axis=1) / 12) + 1e-12,
        np.array([arm.joints[j].ratio for j in k]),
        np.maximum(np.max(np.abs(load), axis=0), 1e-12),
        errors,
    )


def _slow(q: Array, dt: float) -> Motion:
    """Angle, speed and acceleration (m, n) of angles (m, n), ``dt`` s apart, as far as they lie in BAND."""
    angle = low_pass(q, BAND, 1.0 / dt)
    speed = rate_along(angle, dt)
    return angle, speed, rate_along(speed, dt)


def _links(q: Array, read: Array, load: Array) -> Array:
    """(m, n) rad (m): angles of the links: they move as their encoders, and on average bear their load (m, n) N m (N).

    A link oscillates on its spring and moves freely in a gap, so its load is not that of the motor's motion. The zeros
    of the encoders may differ: of the mean difference, the part in proportion to the load is a deflection.
    """
    ahead = np.where(np.isfinite(read).all(axis=0), q - read, 0.0)
    varying = load - load.mean(axis=0)
    yielding = np.sum(varying * ahead, axis=0) / np.maximum(np.sum(varying**2, axis=0), 1e-300)
    return np.asarray(q - (ahead - ahead.mean(axis=0)) - yielding * load.mean(axis=0), float)
