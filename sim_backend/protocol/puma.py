"""The simulated arm behind the protocol simulators: the same world that the drivers of the simulated rig sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from experiment import Experiment, demand_of
from sim_backend.protocol.wires import Times, TriggerLine, Wires
from sim_backend.rig.world import World

IN_POSITION = 0.1
"""s after the demand's end at which the controller says that the arm has arrived."""


@dataclass(frozen=True)
class EncoderWire:
    """An encoder input and what is on it.

    Joint (from 0), and for an absolute encoder its counts per rad of the joint and the joint's position at count 0.
    ``counts_per_radian`` None: the square lines of the motor's sine encoder.
    """

    joint: int
    counts_per_radian: float | None = None
    offset: float = 0.0


@dataclass(frozen=True)
class CurrentWire:
    """An analogue input and the transducer on it: joint (from 0); ``amperes`` True: a sensor that gives A, not V."""

    joint: int
    amperes: bool = False


class ArmBehindTerminal:
    """sim_backend.protocol.wires.Arm: moves as a VAL controller's commands say, under the arm's servos.

    full_speed, full_acceleration  (n,) rad/s and rad/s2 of the controller at 100 %
    """

    def __init__(self, world: World, gear: Array, full_speed: list[float], full_acceleration: list[float]) -> None:
        self._world, self._gear = world, gear
        self._speed, self._acceleration = full_speed, full_acceleration
        self._ends: float | None = None  # s after the beginning of the motion

    def position(self, at: int) -> Array:
        motor: Array = self._world.motor_angle(np.array([at], np.int64))[0]
        return motor / self._gear

    def move(self, target: Array, fraction: float, at: int) -> None:
        motion = Experiment.model_validate(
            {
                "name": "typed",
                "start": self.position(at).tolist(),
                "full_speed": self._speed,
                "full_acceleration": self._acceleration,
                "segment": [{"type": "move", "to": target.tolist(), "speed": fraction}],
            }
        )
        self._world.move(self._world.plant.moving(motion), on_start_line=False)
        self._ends = demand_of(motion).duration + IN_POSITION

    def moving(self, at: int) -> bool:
        moved = self._world.moved_s()
        return self._ends is not None and moved is not None and moved < self._ends

    def halt(self, at: int) -> None:
        if self.moving(at):
            self._world.stop()
        self._ends = None


def warm_up(world: World) -> None:
    """Compiles the arm's dynamics now, so that its first motion does not have to wait for that."""
    rest = world.plant.rest.tolist()
    speeds = [1.0] * len(rest)
    motion = {"name": "warm-up", "start": rest, "full_speed": speeds, "full_acceleration": speeds}
    world.plant.moving(Experiment.model_validate({**motion, "segment": [{"type": "hold", "duration": 1.0}]})).advance()


def wires(
    world: World,
    trigger: TriggerLine,
    encoders: Mapping[int, EncoderWire],
    currents: Mapping[int, CurrentWire],
    *,
    gear: Array,
    target: tuple[float, float, float],
    tracker_from_base: Array | None,
) -> Wires:
    """The terminals of one device: channel -> what is wired to it.

    Channels that are not listed are open (0 counts, 0 V).
    """
    hall = world.electronics.transducer

    motor_counts, motor_angle, transducer_volts = (
        _asked_once(signal) for signal in (world.motor_counts, world.motor_angle, world.transducer_volts)
    )

    def counts(channel: int, at: Times) -> NDArray[np.int64]:
        wire = encoders.get(channel)
        if wire is None or not len(at):
            return np.zeros(len(at), np.int64)
        if wire.counts_per_radian is None:
            return motor_counts(at)[:, wire.joint]
        q = motor_angle(at)[:, wire.joint] / gear[wire.joint]
        return np.rint((q - wire.offset) * wire.counts_per_radian).astype(np.int64)

    def volts(channel: int, at: Times) -> Array:
        wire = currents.get(channel)
        if wire is None or not len(at):
            return np.zeros(len(at))
        v = transducer_volts(at)[:, wire.joint]
        if not wire.amperes:
            return v
        return (v - hall.offset[wire.joint]) * hall.rated_current / hall.rated_voltage / hall.turns[wire.joint]

    def points(at: Times) -> Array:
        homogeneous = np.column_stack([world.target(at, target), np.ones(len(at))])
        return (homogeneous @ (np.eye(4) if tracker_from_base is None else tracker_from_base).T)[:, :3]

    return Wires(counts=counts, volts=volts, points=points, trigger=trigger)


def _asked_once(signal: Callable[[Times], NDArray]) -> Callable[[Times], NDArray]:
    """The signals of all joints at the same times are computed together: the answer to the last question is kept."""
    last: list[tuple[bytes, NDArray]] = []

    def ask(at: Times) -> NDArray:
        key = at.tobytes()
        if not last or last[0][0] != key:
            last[:] = [(key, signal(at))]
        return last[0][1]

    return ask
