"""What the simulated devices share: settings, faults, clock, trigger line, latches."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from sim_backend.rig.world import world_of
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "world_of",
]
