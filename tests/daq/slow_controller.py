"""The simulated arm's controller, slow to arm or failing to start: a driver as a rig file names it."""

from __future__ import annotations

import time

from drivers import RigContext
from drivers.protocols import Plan
from sim_backend import unimation
from sim_backend.rig.world import world_of


class Config(unimation.Config):
    """arming: s that ``arm`` takes; refusal: what ``start`` raises as a ValueError, '' for nothing."""

    arming: float = 0.0
    refusal: str = ""


class Controller(unimation.Controller):
    """drivers.protocols: Device, ArmController."""

    config: Config

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
