"""The simulated counter card with a plug that a test can pull: while the file ``plug`` exists, it does not answer."""

from __future__ import annotations

from pathlib import Path

from arm_io import DeviceFault
from drivers import RigContext
from drivers.protocols import Block, Identity
from sim_backend import mit_c12
from sim_backend.rig.world import world_of


class Config(mit_c12.Config):
    plug: str


class Card(mit_c12.Card):
    def open(self) -> Identity:
        self._ask()
        return super().open()

    def check(self) -> list[str]:
        self._ask()
        return super().check()

    def read(self) -> Block:
        self._ask()
        return super().read()

    def _ask(self) -> None:
        assert isinstance(self.config, Config)
        if Path(self.config.plug).exists():
            raise DeviceFault(self.name, "does not answer; check its plug")


def make(name: str, config: Config, context: RigContext) -> Card:
    return Card(name, config, world_of(context))
