"""From a recording of a floating base to the smooth motion behind it, on a uniform grid.

Columns that the recording must have beside q: base_x .. base_qw .. (``arm_model.motion.POSE_COLUMNS``: a tracker, USBL
and compass) and thruster1 .. (N, demanded). Where it has the velocities base_vx .. base_wz (a Doppler log, gyroscopes)
they are taken; where not, poses are differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import signal

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.motion import POSE_COLUMNS, VELOCITY_COLUMNS, thruster_column
from arm_model.moving_base import BaseRows, floating, rotations, thrust_of
from daq.recording import Recording
from identification.preprocessing import butterworth, zero_phase
from identification.preprocessing.grid import on_grid, uniform_grid
from identification.preprocessing.mechanism import check_joints

MOTION_BAND = 4.0
"""Hz: low-pass of motion and thrust. A vehicle with its arm moves below 1 Hz."""
COMPARE_BAND = 1.0
"""Hz: low-pass of the wrenches that are compared, the same on both sides."""
ENDS = 1.0
"""s at either end of a recording that filters spoil."""
ROWS_PER_SECOND = 5.0
"""Rows that are kept: five per period of COMPARE_BAND."""
BLOCK_SECONDS = 3.0
"""Length of a block: several times the longest correlation of the residual."""
MOST_ROWS = 100_000
"""Of one recording: each has two hundred numbers. 33 minutes at 50 rows/s."""
HOLE = 0.5
"""s without samples that are bridged at most."""


@dataclass(frozen=True)
class BaseRun:
    """One recording on a uniform grid of dt s: m rows at the full rate.

    position        (m, 3) m of the body frame's origin in the world
    base            attitude, velocity and its rate, body frame
    q, qd, qdd      (m, n) of the joints; torque (m, n) N m, N of their drives
    demand          (m, thrusters) N, within their limits
    thrust          (m, thrusters) N per unit of each gain: what the demands give, behind their time constants
    constants       (thrusters,) s
    kept            rows that are compared, after the second low-pass
    block           (len(kept),) number of each kept row's block, from 0
    """

    name: str
    dt: float
    position: Array
    base: BaseRows
    q: Array
    qd: Array
    qdd: Array
    torque: Array
    demand: Array
    thrust: Array
    constants: tuple[float, ...]
    kept: slice
    block: np.ndarray

    @property
    def t(self) -> Array:
        """(k,) s of the kept rows, from the first row."""
        return np.asarray(self.dt * np.arange(len(self.q)))[self.kept]

    def thrust_of(self, given: Array) -> Array:
        """(m, thrusters) N of what the demands give (m, thrusters), behind their time constants, in the band."""
        return _low_pass(_lagged(given, self.constants, self.dt), MOTION_BAND, self.dt)

    def compared(self, values: Array) -> Array:
        """(kept, ...) of values (m, ...), after the second low-pass."""
        return _low_pass(values, COMPARE_BAND, self.dt)[self.kept]


def base_run(recording: Recording, arm: Arm) -> BaseRun:
    """The run of a recording; InputError where columns are missing or it is too short or has holes."""
    thrusters = floating(arm).thruster
    columns = _columns_of(recording, arm)
    measured = columns.shape[1] > 2 * len(arm) + 7 + len(thrusters)
    t, dt, columns = _gridded(recording, columns)
    columns, torque = columns[:, : -len(arm)], columns[:, -len(arm) :] * arm.joint_array("drive_constant")
    n, m = len(arm), len(thrusters)
    q, pose, demand = columns[:, :n], columns[:, n : n + 7], columns[:, n + 7 : n + 7 + m]
    limits = np.array([thruster.limits for thruster in thrusters]).reshape(m, 2)
    demand = np.clip(demand, *limits.T)
    given = np.array([thrust_of(demand[:, k], one) for k, one in enumerate(thrusters)]).reshape(m, -1).T
    constants = tuple(thruster.time_constant for thruster in thrusters)
    q, thrust = _low_pass(q, MOTION_BAND, dt), _low_pass(_lagged(given, constants, dt), MOTION_BAND, dt)
    attitude = _low_pass(_continuous(pose[:, 3:], recording), MOTION_BAND, dt)
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    position = _low_pass(pose[:, :3], MOTION_BAND, dt)
    if measured:
        velocity = _low_pass(columns[:, n + 7 + m :], MOTION_BAND, dt)
    else:
        velocity = _velocity(position, attitude, dt)
    qd = np.gradient(q, dt, axis=0)
    qdd = np.gradient(qd, dt, axis=0)
    base = BaseRows(attitude, velocity, np.gradient(velocity, dt, axis=0))
    kept = slice(round(ENDS / dt), len(t) - round(ENDS / dt), max(1, round(1 / (ROWS_PER_SECOND * dt))))
    block = ((t[kept] - t[kept][0]) // BLOCK_SECONDS).astype(np.intp)
    return BaseRun(
        recording.path.name,
        dt,
        position,
        base,
        q,
        qd,
        qdd,
        _low_pass(torque, MOTION_BAND, dt),
        demand,
        thrust,
        constants,
        kept,
        block,
    )


def _columns_of(recording: Recording, arm: Arm) -> Array:
    """(rows, c): joints, pose, demands of the thrusters, velocity of the base where it was measured, currents."""
    count = len(floating(arm).thruster)
    names = [*POSE_COLUMNS, *(thruster_column(k) for k in range(count))]
    for name in names:
        if name not in recording.extra:
            raise InputError(
                recording.path,
                f"has no column '{name}'; a recording of a floating base has {POSE_COLUMNS[0]} .. "
                f"{POSE_COLUMNS[-1]} and thruster1 .. thruster{count} (armscope import --keep-extra)",
            )
    check_joints(recording, arm)
    if all(name in recording.extra for name in VELOCITY_COLUMNS):
        names += VELOCITY_COLUMNS
    return np.column_stack([recording.q, *(recording.extra[name] for name in names), recording.i])


def _gridded(recording: Recording, columns: Array) -> tuple[Array, float, Array]:
    where = recording.path
    if len(recording) < 2 or recording.t[-1] - recording.t[0] < 4 * ENDS + 2 * BLOCK_SECONDS:
        raise InputError(where, f"is too short; at least {4 * ENDS + 2 * BLOCK_SECONDS:g} s are needed")
    # instruments with rates of their own: only rows for which all of them have earlier and later readings
    known = [recording.t[np.isfinite(column)] for column in columns.T]
    if not all(len(one) for one in known):
        raise InputError(where, "has a column of joints, pose or thrusters without any value")
    first, last = max(one[0] for one in known), min(one[-1] for one in known)
    if first - recording.t[0] > HOLE or recording.t[-1] - last > HOLE:
        raise InputError(
            where,
            f"has an instrument that is silent for more than {HOLE:g} s at the beginning or the end; cut it there",
        )
    grid, dt = uniform_grid(recording.t)
    grid = grid[(grid >= first) & (grid <= last)]
    if len(grid) > MOST_ROWS:
        raise InputError(where, f"has {len(grid)} rows; at most {MOST_ROWS} at a time are taken for a floating base")
    if dt > 1 / (4 * MOTION_BAND):
        raise InputError(where, f"has {1 / dt:.3g} rows/s; at least {4 * MOTION_BAND:g} are needed")
    values, far = on_grid(recording.t, columns, grid, dt)
    if far.max() > HOLE / 2:
        raise InputError(where, f"has a hole of more than {HOLE:g} s in q, pose or thrusters; use the part before it")
    return grid, dt, values


def _continuous(quaternion: Array, recording: Recording) -> Array:
    """The same attitudes without jumps of sign."""
    length = np.linalg.norm(quaternion, axis=1)
    if length.min() < 0.5 or length.max() > 2.0:
        raise InputError(recording.path, "base_qw .. base_qz are no unit quaternions; expected w, x, y, z of length 1")
    signs = [1.0]
    for before, after in pairwise(quaternion):
        signs.append(signs[-1] * (1.0 if before @ after >= 0 else -1.0))
    return quaternion * np.array(signs)[:, None]


def _velocity(position: Array, attitude: Array, dt: float) -> Array:
    """(m, 6) in the body frame, of poses."""
    rate = np.gradient(attitude, dt, axis=0)
    s, v = attitude[:, :1], attitude[:, 1:]
    spin = 2 * (s * rate[:, 1:] - rate[:, :1] * v - np.cross(v, rate[:, 1:]))
    moved = np.einsum("nji,nj->ni", rotations(attitude), np.gradient(position, dt, axis=0))
    return np.concatenate([moved, spin], axis=1)


def _lagged(demand: Array, constants: Sequence[float], dt: float) -> Array:
    """(m, k) N: thrust behind its ``demand`` (m, k) N, each by a first-order lag of a time constant, s."""
    out = demand.copy()
    for k, constant in enumerate(constants):
        if constant > 0:
            # exact for demands that are straight lines between the rows
            keep = np.exp(-dt / constant)
            slope = (1 - keep) * constant / dt
            start = np.array([slope * demand[0, k]])
            out[:, k] = signal.lfilter([1 - slope, slope - keep], [1.0, -keep], demand[:, k], zi=start)[0]
    return out


def _low_pass(values: Array, band: float, dt: float) -> Array:
    """(m, ...) zero-phase third-order Butterworth along the first axis; band Hz, dt s between rows."""
    low = butterworth(3, band * dt * 2)
    return zero_phase(low, values)
