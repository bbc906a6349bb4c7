"""Instruments of a vehicle: one box that says where it is, how it is turned, how fast, or what its thrusters are asked.

    [[device]]
    name = "imu"
    driver = "sim_backend.navigation"
    gives = ["attitude", "rates"]
    rate = 100.0

A box samples on its own time, free running from the moment it is armed. What a fix is wrong by is white noise; from
``at`` to ``back`` of a fault ``beam_break`` there is none.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from arm_io import DeviceFault, InputError
from arm_io.table import Rate, Table
from arm_io.types import Array
from arm_model.motion import POSE_COLUMNS, VELOCITY_COLUMNS, thruster_column
from drivers import RigContext
from drivers.protocols import Block, Identity, Plan
from sim_backend.arm.vehicle import POSE, VELOCITY
from sim_backend.electronics import noise
from sim_backend.rig.faults import BeamBreak
from sim_backend.rig.latch import TICK_RATE, Latch
from sim_backend.rig.trigger_line import Seen, TriggerLine
from sim_backend.rig.world import World, world_of

Quantity = Literal["position", "attitude", "velocity", "rates", "thrust"]
NotNegative = Annotated[float, Field(ge=0)]
PLACES = {
    "position": slice(0, 3),
    "attitude": slice(3, POSE),
    "velocity": slice(POSE, POSE + 3),
    "rates": slice(POSE + 3, POSE + VELOCITY),
    "thrust": slice(POSE + VELOCITY, None),
}


class Config(Table):
    """One box.

    gives           what it measures: position (USBL with a depth gauge, or a tracker of the tank), attitude (compass
                    and inclinometers), velocity (Doppler log), rates (gyroscopes), thrust (demands of the thrusters,
                    which the vehicle's computer logs)
    rate            readings/s
    position_noise  m, attitude_noise rad, velocity_noise m/s, rate_noise rad/s: standard deviations, per axis
    """

    gives: list[Quantity] = Field(min_length=1)
    rate: Rate = 50.0
    max_rate: Rate = 200.0
    position_noise: NotNegative = 0.005
    attitude_noise: NotNegative = 0.0017
    velocity_noise: NotNegative = 0.003
    rate_noise: NotNegative = 0.0017


class Navigation:
    """drivers.protocols: Device, Latched, Readings."""

    def __init__(self, name: str, config: Config, world: World) -> None:
        self.name, self.config, self._world = name, config, world
        self.rate = config.rate
        thrusters = world.plant.thrusters
        if thrusters is None:
            raise InputError(name, "measures a vehicle, and the base of the rig's arm is fixed; see docs/underwater.md")
        columns = [*POSE_COLUMNS, *VELOCITY_COLUMNS, *(thruster_column(k) for k in range(thrusters))]
        self.readings = tuple(name for quantity in config.gives for name in columns[PLACES[quantity]])
        self._noise = noise.keys(world.settings.seed, f"readings of {name}", POSE - 1 + VELOCITY)
        self._line = TriggerLine(0, 1e9)
        self._latch = Latch(world, name, self._acquire, lambda: self._line)

    def open(self) -> Identity:
        self._latch.open()
        return Identity(
            maker="armscope",
            model="simulated navigation",
            serial=self.name,
            max_rate=self.config.max_rate,
            details={"tick_rate": f"{TICK_RATE:.0f}", "gives": ", ".join(self.config.gives)},
        )

    def check(self) -> list[str]:
        return []

    def arm(self, plan: Plan) -> None:
        if max(plan.rate, self.config.rate) > self.config.max_rate:
            raise DeviceFault(self.name, f"reads at most {self.config.max_rate:g} times per second; lower its rate")
        self._latch.arm(plan)
        period = 1e9 / (self.config.rate * self._world.drift(self.name))
        self._line = TriggerLine(self._world.now() + round(period), period)

    def disarm(self) -> None:
        self._latch.disarm()

    def close(self) -> None:
        self._latch.close()

    def read(self) -> Block:
        return self._latch.read()

    def _acquire(self, seen: Seen) -> Block:
        index = (seen.time - self._world.epoch_ns())[:, None]
        drawn = noise.normals(self._noise, index, 1)[0]
        rows = _with_errors(self._world.base(seen.time), drawn, self.config)
        readings = np.concatenate([rows[:, PLACES[quantity]] for quantity in self.config.gives], axis=1)
        time = (seen.time - self._latch.since_ns()) * 1e-9
        for fault in self._world.faults_of(self.name):
            if isinstance(fault, BeamBreak):
                readings[(time >= fault.at) & (time < fault.back)] = np.nan
        none = np.empty(0, np.int64)
        return Block(none, none, none, np.empty((len(readings), 0), np.uint8), readings=readings)


def _with_errors(rows: Array, drawn: NDArray[np.float64], config: Config) -> Array:
    """Rows (k, 13 + thrusters) as the instruments show them; ``drawn`` (k, 12) standard normals."""
    shown = rows.copy()
    shown[:, :3] += config.position_noise * drawn[:, :3]
    w, v, half = rows[:, 3:4], rows[:, 4:POSE], 0.5 * config.attitude_noise * drawn[:, 3:6]
    shown[:, 3:4] = w - (v * half).sum(axis=1, keepdims=True)
    shown[:, 4:POSE] = v + w * half + np.cross(v, half)
    shown[:, 3:POSE] /= np.linalg.norm(shown[:, 3:POSE], axis=1, keepdims=True)
    shown[:, POSE : POSE + 3] += config.velocity_noise * drawn[:, 6:9]
    shown[:, POSE + 3 : POSE + VELOCITY] += config.rate_noise * drawn[:, 9:12]
    return shown


def make(name: str, config: Config, context: RigContext) -> Navigation:
    """A closed box."""
    return Navigation(name, config, world_of(context))
