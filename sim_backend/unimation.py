"""The arm's controller as its host sees it: takes an experiment, moves on the start line, stops in a controlled way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault
from arm_io.table import Table
from drivers import RigContext
from drivers.protocols import Identity, Plan
from experiment import Demand, Experiment, demand_of
from sim_backend.arm.signals import Mover
from sim_backend.arm.stopping import StoppedDemand
from sim_backend.rig.world import World, world_of


class Config(Table):
    """waits_for_start_line: the motion begins when the line rises (if low at ``start``), else at ``start``."""

    waits_for_start_line: bool = True


class Controller:
    """drivers.protocols: Device, ArmController."""

    def __init__(self, name: str, config: Config, world: World) -> None:
        self.name, self.config, self._world = name, config, world
        self.joints = len(world.plant.encoder_lines)
        self._experiment: Experiment | None = None
        self._demand: Demand | StoppedDemand | None = None
        self._mover: Mover | None = None
        self._opened = self._started = False

    def open(self) -> Identity:
        self._world.check_plugged(self.name, self._world.epoch_ns())
        self._opened = True
        return Identity(maker="armscope", model="simulated Unimation controller", serial=self.name)

    def check(self) -> list[str]:
        return []

    def arm(self, plan: Plan) -> None:
        self._check_open()

    def disarm(self) -> None: ...

    def close(self) -> None:
        if self._opened and self._started:
            self._world.stop()
        self._opened = self._started = False

    def load(self, experiment: object) -> None:
        """Drives the arm to the experiment's start; DeviceFault where it is not for this arm or leaves its limits."""
        self._check_open()
        if not isinstance(experiment, Experiment):
            raise DeviceFault(self.name, f"takes an Experiment, not a {type(experiment).__name__}")
        if refusal := self._world.plant.loadable(experiment):
            raise DeviceFault(self.name, f"experiment {experiment.name!r}: {refusal}")
        self._experiment, self._demand = experiment, demand_of(experiment)
        self._mover, self._started = self._world.plant.moving(experiment), False
        self._world.stand(np.array(experiment.start))

    def start(self) -> None:
        self._check_open()
        if self._experiment is None:
            raise DeviceFault(self.name, "has no experiment; load one before starting")
        mover = self._mover or self._world.plant.moving(self._experiment)
        self._mover, self._started, self._demand = None, True, demand_of(self._experiment)
        self._world.move(mover, on_start_line=self.config.waits_for_start_line)

    def stop(self) -> None:
        """Slows every joint down at its ramps' acceleration; a motion that waits for the start line does not begin."""
        if self._experiment is None or not self._started or isinstance(self._demand, StoppedDemand):
            return
        moved = self._world.moved_s()
        if moved is not None and self._demand is not None and moved >= self._demand.duration:
            return
        at = self._world.stop()
        self._demand = StoppedDemand(demand_of(self._experiment), at, np.array(self._experiment.full_acceleration))

    def finished(self) -> bool:
        """True ``settle`` s after the motion has ended, or was stopped."""
        self._check_open()
        if self._demand is None or not self._started:
            return False
        moved = self._world.moved_s()
        if moved is None:
            return False
        return moved >= self._demand.duration + self._world.settings.settle

    def demand(self, times: NDArray[np.float64]) -> NDArray[np.float64] | None:
        if self._demand is None:
            return None
        return self._demand(times)

    def _check_open(self) -> None:
        if not self._opened:
            raise DeviceFault(self.name, "is not open; open it first")
        self._world.check_plugged(self.name, self._world.epoch_ns())


def make(name: str, config: Config, context: RigContext) -> Controller:
    """A closed controller."""
    return Controller(name, config, world_of(context))
