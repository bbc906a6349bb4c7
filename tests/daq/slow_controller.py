"""The simulated arm's controller, slow to arm or failing to start: a driver as a rig file names it."""

from __future__ import annotations

import threading
import time
from typing import Any

from arm_io import DeviceFault
from drivers import RigContext
from drivers.protocols import Plan
from sim_backend import unimation
from sim_backend.rig.world import world_of


class Config(unimation.Config):
    """arming, approach: s that ``arm`` and ``load`` take; refusal: the ValueError of ``start``, or nothing."""

    arming: float = 0.0
    approach: float = 0.0
    refusal: str = ""


class Controller(unimation.Controller):
    """drivers.protocols: Device, ArmController."""

    config: Config

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._halted = threading.Event()

    def load(self, experiment: Any) -> None:
        """Drives to the start pose, and is stopped on its way there."""
        self._halted.clear()
        if self._halted.wait(self.config.approach):
            raise DeviceFault(self.name, "was stopped on its way to the start pose")
        super().load(experiment)

    def stop(self) -> None:
        self._halted.set()
        super().stop()

    def arm(self, plan: Plan) -> None:
        super().arm(plan)
        time.sleep(self.config.arming)

    def start(self) -> None:
        if self.config.refusal:
            raise ValueError(self.config.refusal)
        super().start()


def make(name: str, config: Config, context: RigContext) -> Controller:
    """A closed controller."""
    return Controller(name, config, world_of(context))
