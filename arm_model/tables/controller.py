"""Servos of an arm."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator
from pydantic.dataclasses import dataclass

from arm_model.tables.fields import STRICT, NotNegative, Positive


@dataclass(frozen=True, config=STRICT)
class Controller:
    """Independent-joint servos, evaluated at every servo tick.

    With qm the motor angle over the gear ratio, and v its difference quotient after a low-pass:

        current = position_gain (r - qm) + integral_gain int (r - qm) dt + velocity_gain (velocity_reference r' - v)

    clipped at torque_limit / (abs(gear) k), behind a current loop of first order. Gains come either per joint as they
    stand (kind "gains", A/rad, A/(rad s), A s/rad; V and m for the EMPS), as a cascade (kind "cascade": velocity_gain,
    and position_gain in 1/s that makes the velocity demand), or from a bandwidth (kind "bandwidth": J = diagonal of the
    mass matrix at inertia_pose plus reflected rotors, Kp = wn^2 J, Kd = 2 zeta wn J, Ki = integral_rate Kp, over
    abs(gear) k).
    """

    setpoint_period: Positive = 0.028  # s between the host's setpoints; the servo interpolates linearly
    servo_period: Positive = 0.000875  # s
    kind: Literal["bandwidth", "cascade", "gains"] = "bandwidth"
    natural_frequency: tuple[Positive, ...] | None = None  # rad/s, kind "bandwidth", as are the next three
    damping_ratio: Positive = 1.0
    integral_rate: NotNegative = 0.0  # 1/s
    inertia_pose: tuple[float, ...] | None = None  # rad
    position_gain: tuple[float, ...] | None = None
    velocity_gain: tuple[float, ...] | None = None
    integral_gain: tuple[float, ...] | None = None
    velocity_reference: NotNegative = 1.0  # share of the demanded velocity that the velocity loop is given
    velocity_bandwidth: Positive | None = None  # rad/s of the low-pass on the differenced angle; absent: no low-pass
    current_lag: NotNegative = 0.0  # s, time constant of the current loop

    @model_validator(mode="after")
    def _gains_are_there(self) -> Controller:
        wanted = {
            "bandwidth": ("natural_frequency", "inertia_pose"),
            "cascade": ("position_gain", "velocity_gain"),
            "gains": ("position_gain", "velocity_gain"),
        }[self.kind]
        for name in wanted:
            if getattr(self, name) is None:
                raise ValueError(f"a controller of kind {self.kind!r} needs '{name}', one entry per joint")
        return self
