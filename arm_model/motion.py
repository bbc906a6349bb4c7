"""What a simulated arm did, row by row."""

from __future__ import annotations

from dataclasses import dataclass

from arm_io.types import Array


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
    """

    t: Array
    q: Array
    qd: Array
    qm: Array
    qmd: Array
    current: Array
    torque: Array
    demand: Array
