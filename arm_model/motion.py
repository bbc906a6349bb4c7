"""What a simulated arm did, row by row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array

POSE_COLUMNS = ("base_x", "base_y", "base_z", "base_qw", "base_qx", "base_qy", "base_qz")
"""Columns of a recording: position of the body frame's origin in the world, m; attitude, unit quaternion w, x, y, z."""
VELOCITY_COLUMNS = ("base_vx", "base_vy", "base_vz", "base_wx", "base_wy", "base_wz")
"""m/s and rad/s of the base in its body frame: what a Doppler log and the gyroscopes of an IMU show."""


def thruster_column(k: int) -> str:
    """Column of the demanded thrust of thruster k (from 0), N."""
    return f"thruster{k + 1}"


@dataclass(frozen=True)
class BaseTrack:
    """What a floating base did: R rows, behind the axis of lanes of a batch.

    position (..., R, 3) m of the body frame's origin in the world; attitude (..., R, 4) unit quaternion w, x, y, z,
    body to world; velocity (..., R, 6) m/s, rad/s in the body frame; demand (..., R, thrusters) N of each thruster.
    """

    position: Array
    attitude: Array
    velocity: Array
    demand: Array

    def columns(self) -> dict[str, Array]:
        """Columns of a recording (``POSE_COLUMNS`` and so on) -> (R,), of one simulation."""
        values = np.concatenate([self.position, self.attitude, self.velocity], axis=-1)
        names = (*POSE_COLUMNS, *VELOCITY_COLUMNS)
        return dict(zip(names, values.T)) | {thruster_column(k): one for k, one in enumerate(self.demand.T)}

    def lane(self, number: int) -> BaseTrack:
        """One lane of a batch."""
        return BaseTrack(self.position[number], self.attitude[number], self.velocity[number], self.demand[number])


@dataclass(frozen=True)
class Motion:
    """R rows of n joints; batches have a leading axis of lanes in everything but t and, where it is shared, demand.

    t        (R,) s from the start
    q, qd    (..., R, n) joint angle and its rate, link side: rad, rad/s (m, m/s)
    qm, qmd  (..., R, n) the motor's angle over the gear ratio, and its rate: what the motor encoder shows
    current  (..., R, n) A in the motor (V, N m where the model's controller has them), positive drives the joint
             positive
    torque   (..., R, n) N m at the joint side that the current makes
    demand   (..., R, n) demanded joint positions, rad (m); currents for an arm without controller
    base     what the base did, if it floats
    """

    t: Array
    q: Array
    qd: Array
    qm: Array
    qmd: Array
    current: Array
    torque: Array
    demand: Array
    base: BaseTrack | None = None
