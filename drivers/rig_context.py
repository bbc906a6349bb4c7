"""What the drivers of one rig share: handed to every driver's ``make``."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from drivers.clock import SystemClock
from drivers.protocols import HostClock

Shared = TypeVar("Shared")


@dataclass(kw_only=True)
class RigContext:
    """One per rig, made before its devices (``daq.rig.rig_file.context_of``).

    simulation  table [simulation] of the rig file
    model       path of the arm's model; None: the rig has none
    folder      of the rig file, to which its paths are relative
    gears       (J,) motor angle over joint position, with its sign
    counts      (J,) x4 counts of each joint's encoder per rad (m) of the joint, with the sign; None: no encoder
    clock       the host's time. A backend that runs on its own time puts its clock here, at the latest when its
                devices have been opened
    """

    simulation: dict[str, Any] = field(default_factory=dict)
    model: Path | None = None
    folder: Path = Path()
    gears: tuple[float, ...] = ()
    counts: tuple[float | None, ...] = ()
    clock: HostClock = field(default_factory=SystemClock)
    _shared: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def shared(self, key: Hashable, make: Callable[[], Shared]) -> Shared:
        """The rig's one object under ``key``, such as a bus or a simulated arm; made when the first driver asks."""
        if key not in self._shared:
            self._shared[key] = make()
        found: Shared = self._shared[key]
        return found
